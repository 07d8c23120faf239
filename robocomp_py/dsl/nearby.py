"""Files with similar names, for a file that is missing."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path, PurePosixPath

from .diagnostics import mistyped


def nearby(
    path: Path, written: str, taken: Collection[str] = (), likely: str = "", models: Collection[str] = ()
) -> str:
    """`did you mean `explorer.pdsl`?` for a missing file, if its folder has a file with a similar name and its ending.

    It proposes none of the `taken` files, and preferably one with the name `likely`. If the folder is missing, too, it
    proposes a file of the same name in a folder with a similar name. Without an ending, it proposes a file of this name
    with the first of the endings `models` that is there, or a folder with a similar name. With a misspelt ending, it
    proposes a file with the right one.
    """
    try:
        is_sought = Path.is_file if path.suffix else Path.is_dir
        names = [each.name for each in path.parent.iterdir() if each.suffix == path.suffix and is_sought(each)]
    except FileNotFoundError:
        return _in_folder_beside(path, written)
    except (OSError, ValueError):  # a file, or a name that cannot be one
        return ""
    folder = PurePosixPath(written).parent
    if path.name and not path.suffix:
        for ending in models:
            if path.with_suffix(ending).is_file():
                return f"did you mean `{folder / f'{path.name}{ending}'}`?"
    names = [each for each in names if str(folder / each) not in taken and each != path.name]
    near = f"{likely}{path.suffix}"
    near = near if near in names else mistyped(path.name, names)
    if path.suffix and path.suffix not in models and not near:
        meant = (path.with_suffix(each) for each in models if mistyped(path.suffix, [each]))
        near = next((each.name for each in meant if each.is_file()), "")
    return f"did you mean `{folder / near}`?" if near else ""


def _in_folder_beside(path: Path, written: str) -> str:
    folder = PurePosixPath(written).parent
    if folder.name in ("", ".."):
        return ""
    try:
        names = [each.name for each in path.parent.parent.iterdir() if (each / path.name).is_file()]
    except (OSError, ValueError):
        return ""
    near = mistyped(folder.name, names)
    return f"did you mean `{folder.with_name(near) / path.name}`?" if near else ""
