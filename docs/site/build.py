#!/usr/bin/env python3
"""Builds the pages as a site in build/docs and checks every link of the result; run by ./dev docs.

Exit code 1 where mkdocs warns, a page is in no menu, or a link leads to no file or no anchor.
"""

import html.parser
import pathlib
import re
import shutil
import subprocess
import sys
import urllib.parse

project = pathlib.Path(__file__).resolve().parents[2]
pages, site = project / "build/docs_pages", project / "build/docs"


def copy_pages():
    """The pages and whatever else of the project they may link to, at the same places."""
    shutil.rmtree(pages, ignore_errors=True)
    listed = subprocess.run(["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard", "--", "*.md", "LICENSE",
                             "docs", "examples", "models", "scripts", "third_party"],
                            cwd=project, check=True, capture_output=True, text=True).stdout
    for name in filter(None, listed.split("\0")):
        if name.startswith(("docs/site/", "tests/", "benchmarks/")) or not (project / name).exists():
            continue
        (pages / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(project / name, pages / name)
    # Folders that pages link to: on the site, a list of what is in them.
    for folder, title, kind in [("docs/decisions", "Decisions", "*.md"), ("docs/samples", "Samples", "*.lua"),
                                ("examples/library", "Example of the library", "*.*")]:
        lines = [f"# {title}\n"]
        for file in sorted((pages / folder).glob(kind)):
            head = file.read_text().splitlines()[0].lstrip("# ") if kind == "*.md" else file.name
            lines.append(f"- [{head}]({file.name})")
        (pages / folder / "index.md").write_text("\n".join(lines) + "\n")


class Page(html.parser.HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.links, self.anchors = [], set()
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        if values.get("id"):
            self.anchors.add(values["id"])
        for key in ("href", "src"):
            if values.get(key):
                self.links.append(values[key])


def dead_links():
    read = {file: Page(file.read_text()) for file in site.rglob("*.html") if file.name != "404.html"}
    for file, page in sorted(read.items()):
        for link in page.links:
            parts = urllib.parse.urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            path = urllib.parse.unquote(parts.path)
            target = (file.parent / path).resolve() if path else file
            if target.is_dir():
                target = target / "index.html"
            if not target.is_file():
                yield f"{file.relative_to(site)} links to {link}, which is not there"
            elif parts.fragment and target in read and urllib.parse.unquote(parts.fragment) not in read[target].anchors:
                yield f"{file.relative_to(site)} links to {link}, a heading that is not there"


def pages_without_menu():
    menu = (project / "docs/site/mkdocs.yml").read_text()
    for file in sorted((project / "docs").glob("**/*.md")):
        name = str(file.relative_to(project))
        if not name.startswith("docs/decisions/") and not re.search(rf"[ ]{re.escape(name)}$", menu, re.M):
            yield f"{name} is not in the menu of docs/site/mkdocs.yml"


copy_pages()
if subprocess.run(["mkdocs", "build", "--strict", "--quiet", "--config-file", project / "docs/site/mkdocs.yml"]).returncode:
    sys.exit(1)
faults = [*pages_without_menu(), *dead_links()]
print("\n".join(faults) or f"Site: {site}/index.html; with search: python3 -m http.server --directory {site}")
sys.exit(bool(faults))
