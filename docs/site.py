#!/usr/bin/env python3
"""The documents as a site: mdBook from all Markdown of the repository, the API of the crates and of the Python package.

    docs/site.py [--api] [FOLDER, else target/site]

Needs mdbook (cargo install mdbook). --api: besides the documentation of the crates (cargo doc) and, where pdoc and the package
`skin` are installed for this Python, of the package. Every link of the site that leads to the site is then followed.
Exit code 77 where mdbook is missing.
"""

import html.parser
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import urllib.parse

ROOT = os.path.realpath(os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
CRATES = ["protocol", "firmware", "parts", "link", "recording", "forward", "inverse", "view", "hil_sim", "studies"]


def tracked():
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True).stdout
    return sorted(path for path in listed.splitlines() if os.path.exists(os.path.join(ROOT, path)))


def lay_out(source, with_python):
    """The pages where they are in the repository, so that their links hold, and every file that one links to."""
    files = tracked()
    pages = [f for f in files if f.endswith(".md") and f != "docs/SUMMARY.md"]
    wanted = set(pages)
    for page in pages:
        text = open(os.path.join(ROOT, page), encoding="utf-8").read()
        for target in re.findall(r"\]\(([^)#\s:]+)[^):\s]*\)", text):
            path = os.path.normpath(os.path.join(os.path.dirname(page), target))
            if path in files:
                wanted.add(path)
    for path in sorted(wanted):
        os.makedirs(os.path.dirname(os.path.join(source, path)), exist_ok=True)
        shutil.copyfile(os.path.join(ROOT, path), os.path.join(source, path))
    contents = open(os.path.join(ROOT, "docs/SUMMARY.md"), encoding="utf-8").read()
    contents = re.sub(r"\]\(([^)]+)\)", lambda m: f"]({os.path.normpath(os.path.join('docs', m.group(1)))})", contents)
    # Only so are they pages of the site.
    missing = [page for page in pages if f"]({page})" not in contents]
    titles = {page: re.search(r"^# (.+)$", open(os.path.join(ROOT, page), encoding="utf-8").read(), re.M) for page in missing}
    contents += "\n# More\n\n- [API](api.md)\n"
    contents += "".join(f"- [{titles[page].group(1) if titles[page] else page}]({page})\n" for page in missing)
    with open(os.path.join(source, "SUMMARY.md"), "w", encoding="utf-8") as file:
        file.write(contents)
    with open(os.path.join(source, "api.md"), "w", encoding="utf-8") as file:
        file.write("# API\n\nOf the crates, as `cargo doc` shows them:\n\n")
        file.writelines(f"- [{name}](api/rust/{name}/index.html)\n" for name in CRATES)
        if with_python:
            file.write("\nOf the Python package: [skin](api/python/skin.html). How to use it: [Python](docs/python.md).\n")


class Links(html.parser.HTMLParser):
    def __init__(self):
        super().__init__()
        self.targets, self.ids = [], set()

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.ids.update(v for k, v in attrs if k in ("id", "name") and v)
        for key in ("href", "src"):
            if attributes.get(key) and tag != "base":
                self.targets.append(attributes[key])


def follow(site):
    """Links of the book's pages that lead nowhere on the site."""
    pages = {}
    for folder, _, names in os.walk(site):
        for name in names:
            # What cargo doc and pdoc make is theirs to check; 404.html is shown at any address.
            if name.endswith(".html") and name not in ("404.html", "print.html", "toc.html"):
                path = os.path.join(folder, name)
                if not os.path.relpath(path, site).startswith("api" + os.sep):
                    pages[path] = Links()
                    pages[path].feed(open(path, encoding="utf-8").read())
    for page, links in pages.items():
        for target in links.targets:
            parts = urllib.parse.urlsplit(target)
            if parts.scheme or parts.netloc:
                continue
            path = os.path.normpath(os.path.join(os.path.dirname(page), urllib.parse.unquote(parts.path))) if parts.path else page
            if not os.path.exists(path):
                yield f"{os.path.relpath(page, site)}: {target}"
            elif parts.fragment and path in pages and urllib.parse.unquote(parts.fragment) not in pages[path].ids:
                yield f"{os.path.relpath(page, site)}: {target}: no such heading"


def main():
    arguments = sys.argv[1:]
    api = "--api" in arguments
    arguments = [a for a in arguments if a != "--api"]
    if len(arguments) > 1 or any(a.startswith("-") for a in arguments):
        sys.exit(__doc__)
    if shutil.which("mdbook") is None:
        print("no mdbook (cargo install mdbook)")
        sys.exit(77)
    target = os.environ.get("CARGO_TARGET_DIR", os.path.join(ROOT, "target"))
    site = os.path.realpath(arguments[0] if arguments else os.path.join(target, "site"))
    work = os.path.join(target, "site-source")
    for folder in (work, site):
        shutil.rmtree(folder, ignore_errors=True)
    with_python = api and all(importlib.util.find_spec(name) for name in ("pdoc", "skin"))
    lay_out(os.path.join(work, "src"), with_python)
    for name in ("book.toml", "site.css"):
        shutil.copyfile(os.path.join(ROOT, "docs", name), os.path.join(work, name))
    subprocess.run(["mdbook", "build", work, "--dest-dir", site], check=True)
    if api:
        subprocess.run(["cargo", "doc", "--workspace", "--no-deps", "--locked"], cwd=ROOT, check=True)
        shutil.copytree(os.path.join(target, "doc"), os.path.join(site, "api/rust"))
        if with_python:
            subprocess.run([sys.executable, "-m", "pdoc", "skin", "-o", os.path.join(site, "api/python")], check=True)
        else:
            print("site.py: without the Python package's API: pip install pdoc tactile-skin")
    broken = [line for line in follow(site) if api or "api/rust" not in line]
    if broken:
        sys.exit("site.py: links that lead nowhere:\n" + "\n".join(broken))
    print(f"site.py: {site}/index.html")


main()
