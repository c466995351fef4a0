#!/usr/bin/env python3
"""Whether the documents hold together: every relative link and its anchor leads somewhere, and every package that a command
names with -p is there. Needs no network. Usage: tests/links.py
"""

import os
import re
import subprocess
import sys
import tomllib

ROOT = os.path.realpath(os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))


def tracked():
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True).stdout
    return {path for path in listed.splitlines() if os.path.lexists(os.path.join(ROOT, path))}


def read(path):
    with open(os.path.join(ROOT, path), encoding="utf-8") as file:
        return file.read()


def prose(text):
    """A document without its blocks of code, with as many lines."""
    lines, fence = [], None
    for line in text.splitlines():
        mark = re.match(r"\s*(```+|~~~+)", line)
        if fence is None and mark:
            fence = mark.group(1)
            lines.append("")
        elif fence is not None:
            if line.strip().startswith(fence):
                fence = None
            lines.append("")
        else:
            lines.append(line)
    return "\n".join(lines)


def anchors(text):
    """The anchors of a document's headings, as GitHub and mdBook make them."""
    seen, result = {}, set()
    for heading in re.findall(r"^#{1,6}[ \t]+(.+?)[ \t]*#*$", prose(text), re.M):
        plain = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", heading).replace("`", "")
        slug = re.sub(r"[^\w\- ]", "", plain.lower()).replace(" ", "-")
        number = seen.get(slug, 0)
        seen[slug] = number + 1
        result.add(f"{slug}-{number}" if number else slug)
    return result | set(re.findall(r"<a (?:id|name)=\"([^\"]+)\"", text))


def links(text):
    """Line and target of every link and picture that is no address."""
    for number, line in enumerate(prose(text).splitlines(), 1):
        line = re.sub(r"`[^`]*`", "", line)
        found = re.findall(r"\]\(<?([^)\s>]+)>?(?:\s+\"[^\"]*\")?\)", line) + re.findall(r"^\[[^\]]+\]:\s*(\S+)", line)
        found += re.findall(r"(?:href|src)=\"([^\"]+)\"", line)
        for target in found:
            if not re.match(r"[a-z][a-z+.-]*:", target):
                yield number, target


def leads(page, target, files):
    """Why a link leads nowhere; None if it does."""
    path, _, anchor = target.partition("#")
    where = os.path.normpath(os.path.join(os.path.dirname(page), path)) if path else page
    if where.startswith("..") or os.path.isabs(path):
        return "leads out of the repository"
    folder = any(file.startswith(where + "/") for file in files)
    if where not in files and not folder:
        return "there is no such file"
    if anchor and where.endswith(".md") and anchor not in anchors(read(where)):
        return "there is no such heading"
    return None


def packages():
    """Names that cargo takes after -p in this repository."""
    members = tomllib.loads(read("Cargo.toml"))["workspace"]["members"]
    return {tomllib.loads(read(f"{member}/Cargo.toml"))["package"]["name"] for member in members}


def main():
    files = tracked()
    pages = sorted(file for file in files if file.endswith(".md"))
    wrong, count = [], 0
    for page in pages:
        for number, target in links(read(page)):
            count += 1
            reason = leads(page, target, files)
            if reason:
                wrong.append(f"{page}:{number}: {target}: {reason}")
    known = packages()
    for file in sorted(files):
        if file.endswith((".md", ".sh", ".rs", ".py", ".yml")):
            for number, line in enumerate(read(file).splitlines(), 1):
                if re.search(r"\bcargo (\+\S+ )?(test|run|check|build|bench|clippy|doc|miri|publish|tree)\b", line):
                    # After -- the arguments are the program's.
                    for name in re.findall(r"(?:^|\s)(?:-p|--package)[ =]([a-z][\w-]*)", line.split(" -- ")[0]):
                        if name not in known:
                            wrong.append(f"{file}:{number}: cargo has no package {name} here")
    if wrong:
        sys.exit("links.py:\n" + "\n".join(wrong))
    print(f"links.py: {count} links on {len(pages)} pages")


main()
