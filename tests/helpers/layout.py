"""The layout of a package, as its imports say it: the rooms directly in its folder, from low to high."""

import ast
from collections.abc import Sequence
from pathlib import Path


class Layout:
    """A package in the folder ``root``, whose name is that of the folder.

    ``rooms``: modules and folders of modules directly in it, from low to high; those of one row may import each other.
    A module may import its own row and those above it there.
    """

    def __init__(self, root: Path, rooms: Sequence[set[str]]):
        self.root = root
        self.level = {name: level for level, names in enumerate(rooms) for name in names}
        self.files = sorted(root.rglob("*.py"))
        self.modules = [p for p in self.files if p.parent != root or p.stem not in ("__init__", "__main__")]
        self._names = {self.module_of(path) for path in self.files}
        self._imported: dict[Path, set[str]] = {}

    def room(self, path: Path) -> str:
        """The module, or the folder of modules, directly in the package."""
        return path.relative_to(self.root).with_suffix("").parts[0]

    def module_of(self, path: Path) -> str:
        """Its name within the package, with dots; a folder for its ``__init__``, empty for that of the package."""
        parts = path.relative_to(self.root).with_suffix("").parts
        return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)

    def imported(self, path: Path) -> set[str]:
        """Modules of the package that a file imports anywhere, inside of functions and for type checking too."""
        if path not in self._imported:
            self._imported[path] = self._read_imports(path)
        return self._imported[path]

    def _read_imports(self, path: Path) -> set[str]:
        found = set()
        package = (self.root.name, *path.relative_to(self.root).parent.parts)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name.split(".") for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                base = list(package[:len(package) - node.level + 1]) if node.level else []
                base += node.module.split(".") if node.module else []
                names = [[*base, alias.name] for alias in node.names]
            for name in (name[1:] for name in names if len(name) > 1 and name[0] == self.root.name):
                while ".".join(name) not in self._names:  # something in a module
                    name = name[:-1]
                found.add(".".join(name))
        return found - {""}

    def imported_rooms(self, path: Path) -> set[str]:
        """The rooms of these modules."""
        return {name.split(".")[0] for name in self.imported(path)}

    def require_order(self, *paths: Path) -> None:
        """Complain of all modules, or of these, that have no room or import from a higher one."""
        wrong = list(filter(None, map(self._complaint, paths or self.modules)))
        assert not wrong, "\n".join(wrong)

    def _complaint(self, path: Path) -> str | None:
        own, file = self.room(path), path.relative_to(self.root)
        if own not in self.level:
            return f"{file}: {own} has no place in the order of {self.root.name}"
        higher = {name for name in self.imported_rooms(path) if self.level.get(name, -1) > self.level[own]}
        return f"{file}: {own} imports {', '.join(sorted(higher))}" if higher else None

    def require_rooms(self) -> None:
        """Complain of rooms in the order that the package has not got."""
        gone = set(self.level) - {self.room(path) for path in self.modules}
        assert not gone, f"no longer there: {', '.join(sorted(gone))}"

    def cycle_of_modules(self) -> list[str]:
        """Modules that need each other; none if there are none."""
        return cycle({self.module_of(path): self.imported(path) - {self.module_of(path)} for path in self.files})

    def cycle_of_folders(self) -> list[str]:
        """The same of folders within rooms, each of them as a whole, and of the modules beside them."""

        def whole(name: str) -> str:
            return name.rpartition(".")[0] if name.count(".") > 1 else name

        graph: dict[str, set[str]] = {}
        for path in self.files:
            node = whole(self.module_of(path))
            graph.setdefault(node, set()).update({whole(name) for name in self.imported(path)} - {node})
        return cycle(graph)


def cycle(graph: dict[str, set[str]]) -> list[str]:
    """Nodes that need each other, in order, the first one again at the end; none if there are none."""
    done: set[str] = set()

    def visit(node: str, way: list[str]) -> list[str]:
        if node in way:
            return [*way[way.index(node):], node]
        if node in done:
            return []
        for other in sorted(graph[node]):
            if found := visit(other, [*way, node]):
                return found
        done.add(node)
        return []

    return next((found for node in sorted(graph) if (found := visit(node, []))), [])
