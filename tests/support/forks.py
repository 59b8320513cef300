"""A server that has imported camgen and forks processes, so that none of them imports it again."""

import multiprocessing
from multiprocessing.context import ForkServerContext

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
