"""The files that an arm in a URDF is made of: the URDF and its meshes."""

from __future__ import annotations

from pathlib import Path

from camgen.robots.urdf_xml import read_description

#: Folders above the URDF in which a mesh is looked for.
_FAR_UP = 6


def urdf_files(file: str) -> tuple[Path, ...]:
    """The URDF and the meshes that it names and that are there. InputError for a URDF that cannot be read."""
    described = read_description(Path(file))
    names = dict.fromkeys(shape.mesh for shapes in described.links.values() for shape in shapes if shape.mesh)
    found = [mesh_path(name, Path(file).parent) for name in names]
    return (Path(file), *(path for path in found if path))


def mesh_path(name: str, folder: Path) -> Path | None:
    """The file of a mesh, None if there is none. folder: of the URDF. A path is taken from there. Of
    ``package://arm/meshes/base.stl``, whose package can lie anywhere, as much of the end as there is: beside the URDF,
    or, with the folder it is in, above it.
    """
    scheme, mark, rest = name.partition("://")
    if not mark or scheme == "file":
        found = _file(folder / (rest if mark else name))
        if found or mark:
            return found
    parts = [part for part in Path(rest if mark else name).parts if part not in ("..", "/")]
    homes = [folder, *folder.resolve().parents][: _FAR_UP + 1]
    for count in range(len(parts), 0, -1):
        for home in homes if count > 1 else homes[:1]:
            if found := _file(home.joinpath(*parts[-count:])):
                return found
    return None


def _file(path: Path) -> Path | None:
    try:
        return path if path.is_file() else None
    except (OSError, ValueError):  # a name that no file can have
        return None
