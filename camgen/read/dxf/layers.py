"""Reads the layer table of a DXF document."""

from __future__ import annotations

from ezdxf.document import Drawing

from camgen.model.job import Job
from camgen.read.layers import FROZEN, OFF, Layers


def read_layers(document: Drawing, job: Job) -> Layers:
    """The layers of the document, with the globs and the clamps of the job."""
    names, states = {}, {}
    for layer in document.layers:
        name = str(layer.dxf.name)
        names[name.casefold()] = name
        if layer.is_frozen():
            states[name.casefold()] = FROZEN
        elif layer.is_off():
            states[name.casefold()] = OFF
    globs = tuple(glob.strip() for glob in job.input.layers)
    return Layers(names, states, globs, job.clamp_layers)
