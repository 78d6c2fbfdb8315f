"""References in docstrings: to where a class is documented, which is not always where
it is defined.
"""

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

BEFORE_NAPOLEON, AFTER_NAPOLEON = 400, 600  # which comes at 500


def setup(app: Sphinx) -> dict[str, bool]:
    """Resolve what is left open, and keep the sentences of properties whole."""
    written: dict[str, list[str]] = {}

    def keep(
        _app: Sphinx,
        what: str,
        name: str,
        _object: object,
        _options: object,
        lines: list[str],
    ) -> None:
        if what == "property":
            written[name] = list(lines)

    def restore(
        _app: Sphinx,
        what: str,
        name: str,
        _object: object,
        _options: object,
        lines: list[str],
    ) -> None:
        """Restore the lines: Napoleon mistakes text before a colon in a property's
        first line for a type.
        """
        if what == "property":
            lines[:] = written.pop(name)

    app.connect("missing-reference", _documented_elsewhere)
    app.connect("autodoc-process-signature", _without_factories)
    app.connect("autodoc-process-docstring", keep, priority=BEFORE_NAPOLEON)
    app.connect("autodoc-process-docstring", restore, priority=AFTER_NAPOLEON)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _without_factories(
    _app: Sphinx,
    _what: str,
    _name: str,
    _object: object,
    _options: object,
    signature: str | None,
    returned: str | None,
) -> tuple[str | None, str | None]:
    """Show `...` for the default of a field that a function makes."""
    return signature and signature.replace("<factory>", "..."), returned


def _documented_elsewhere(
    app: Sphinx,
    environment: BuildEnvironment,
    node: pending_xref,
    content: nodes.TextElement,
) -> nodes.reference | None:
    """Return a link to the one object of a name, by whatever module it is documented:
    `InputError`, `study.Study`.
    """
    if node.get("refdomain") != "py":
        return None
    python = environment.domains.python_domain
    name = node["reftarget"].rsplit(".", 1)[-1]
    found = [
        full for full in python.objects if full == name or full.endswith(f".{name}")
    ]
    if len(found) != 1:
        return None
    node["reftarget"] = found[0]
    return python.resolve_xref(
        environment,
        node["refdoc"],
        app.builder,
        node["reftype"],
        found[0],
        node,
        content,
    )
