"""A server that has imported camgen and forks processes, so that none of them imports it again."""

import multiprocessing
import sys
from collections.abc import Callable
from multiprocessing.context import ForkServerContext, ForkServerProcess

import pytest

#: Most modules of a builder, and of `camgen open`, which take 0.4 s and 0.3 s to import.
MODULES = [
    "camgen.batch.perform",
    "camgen.cli.open",
    "camgen.workbench.server",
    "camgen.lang.gcode.run",
    "camgen.order.arrange",
    "camgen.order.proven",
    "camgen.plan.operations",
    "camgen.read.dxf.document",
    "camgen.check.stock",
    "camgen_posts.gcode",
    "camgen_posts.pacscript",
    "camgen_posts.rapid",
    "camgen_posts.vplus",
    "ezdxf",
    "shapely",
    "uvicorn.lifespan.on",
    "uvicorn.protocols.http.h11_impl",
    "tests.support.benches",
]


def get_server() -> ForkServerContext:
    """The context of the server. Each process of tests has one, which its first use starts."""
    server = multiprocessing.get_context("forkserver")
    server.set_forkserver_preload(MODULES)
    return server


def start_process(function: Callable[..., None], *arguments: object) -> ForkServerProcess:
    """Starts a process of the server that calls a function."""
    process = get_server().Process(target=function, args=arguments)
    # A process imports the main module of its parent again, so it is hidden.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys.modules["__main__"], "__spec__", None)
        patch.delattr(sys.modules["__main__"], "__file__", raising=False)
        process.start()
    return process
