"""Excerpts of search results without a network: browsers refuse `fetch` to pages that
are opened as files.
"""

import json
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx

FILE = "excerpts.js"
# Answer the search's request for a page with the stored content.
FETCH = """
const fetchElsewhere = window.fetch;
window.fetch = (address, ...others) => {
  const name = String(address).replace(/^\\.\\/|\\.html$/g, "");
  if (name in PAGES) return Promise.resolve(new Response(PAGES[name]));
  return fetchElsewhere(address, ...others);
};
"""


def setup(app: Sphinx) -> dict[str, bool]:
    """Store each page's content, and load it into the search page."""
    pages: dict[str, str] = {}

    def keep(
        app: Sphinx,
        name: str,
        _template: str,
        context: dict[str, object],
        document: nodes.Node | None,
    ) -> None:
        if document is not None:
            pages[name] = f'<div role="main">{context["body"]}</div>'
        elif name == "search":
            app.add_js_file(FILE)

    def write(app: Sphinx, _fault: Exception | None) -> None:
        text = f"const PAGES = {json.dumps(pages)};\n{FETCH}"
        Path(app.outdir, "_static", FILE).write_text(text, encoding="utf-8")

    app.connect("html-page-context", keep)
    app.connect("build-finished", write)
    return {"parallel_read_safe": True, "parallel_write_safe": False}
