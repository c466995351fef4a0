#!/usr/bin/env python3
"""Whose code is in `skin`: THIRD-PARTY.md from the lock file, and whether all of it may be there.

    tests/third_party.py             writes THIRD-PARTY.md
    tests/third_party.py --check     fails if THIRD-PARTY.md is not what would be written
    tests/third_party.py --texts     all licence texts on stdout, to go with a compiled program

Every run fails where a licence or a source is not among those that deny.toml allows, be it the program's, a board's, or one
that the fuzz targets or a bench are built with. Needs no network: cargo has the libraries already (cargo fetch, with
--manifest-path for each of them).
"""

import glob
import json
import os
import re
import subprocess
import sys
import tomllib

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..")
NOTICES = os.path.join(ROOT, "THIRD-PARTY.md")
HEAD = """# Third parties

What others wrote of the program `skin`, on all systems together, for its build and its run. What only tests, benches
and boards use is not listed. `tests/third_party.py` writes this page, and `tests/third_party.py --texts` all licence texts, which have
to go with a compiled program.

- `serialport` is under the Mozilla Public License 2.0. It is used unchanged. Its source is at the address below, and
  `cargo vendor` brings it.
- `dejavu` holds the font DejaVu Sans, which is in the pictures' letters and in the program. Its licence is that of
  Bitstream Vera, with the changes of DejaVu in the public domain. It asks that its notice goes with the font, and that the
  font is not sold by itself. `--texts` prints the notice.

| library | version | licence | source |
|---|---|---|---|
"""


# What has a lock file of its own.
OTHERS = ["fuzz/Cargo.toml", "boards/*/Cargo.toml", "inverse/benches/peers/*/Cargo.toml"]


def metadata(manifest="Cargo.toml"):
    command = ["cargo", "metadata", "--format-version", "1", "--locked", "--offline", "--manifest-path", manifest]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE)
    if done.returncode != 0:
        sys.exit(f"third_party.py: cargo metadata failed; run cargo fetch --manifest-path {manifest} first")
    return json.loads(done.stdout)


def from_elsewhere(data):
    """Packages that are not this repository's."""
    return [p for p in data["packages"] if p["source"] is not None]


def shipped(data):
    """Packages that the program and the Python package need to be built and to run, whatever the system."""
    nodes = {node["id"]: node for node in data["resolve"]["nodes"]}
    packages = {package["id"]: package for package in data["packages"]}
    todo = [p["id"] for p in data["packages"] if p["name"] in ("host", "python") and p["source"] is None]
    seen = set(todo)
    while todo:
        for dependency in nodes[todo.pop()]["deps"]:
            used = any(kind["kind"] != "dev" for kind in dependency["dep_kinds"])
            if used and dependency["pkg"] not in seen:
                seen.add(dependency["pkg"])
                todo.append(dependency["pkg"])
    found = [packages[k] for k in seen if packages[k]["source"] is not None]
    return sorted(found, key=lambda p: (p["name"], [int(n) for n in re.findall(r"\d+", p["version"])]))


def allowed(expression, licences):
    """Whether a licence expression (SPDX; also the old form with a slash) can be met with these licences."""
    tokens = re.findall(r"[()]|[^\s()]+", expression.replace("/", " OR "))

    def either():
        result = both()
        while tokens and tokens[0] == "OR":
            tokens.pop(0)
            result = both() or result
        return result

    def both():
        result = one()
        while tokens and tokens[0] == "AND":
            tokens.pop(0)
            result = one() and result
        return result

    def one():
        token = tokens.pop(0)
        if token == "(":
            result = either()
            tokens.pop(0)
            return result
        if tokens and tokens[0] == "WITH":
            token = " ".join([token, tokens.pop(0), tokens.pop(0)])
        return token in licences

    return either()


def refused(packages):
    """What deny.toml does not allow, a line each."""
    with open(os.path.join(ROOT, "deny.toml"), "rb") as file:
        rules = tomllib.load(file)
    general = set(rules["licenses"]["allow"])
    more = {e["crate"]: set(e["allow"]) for e in rules["licenses"]["exceptions"]}
    registries = {"registry+" + address for address in rules["sources"]["allow-registry"]}
    for package in packages:
        name = f"{package['name']} {package['version']}"
        licence = package["license"] or "no licence"
        if not allowed(licence, general | more.get(package["name"], set())):
            yield f"{name}: {licence} is not allowed by deny.toml"
        if package["source"] not in registries:
            yield f"{name}: its source {package['source']} is not allowed by deny.toml"


def page(packages):
    rows = []
    for package in packages:
        name, version = package["name"], package["version"]
        source = package["repository"] or f"https://crates.io/crates/{name}"
        rows.append(f"| {name} | {version} | {package['license']} | {source} |\n")
    return HEAD + "".join(rows)


def texts(packages):
    """The licence files of every library; equal texts once, with all that they are of."""
    owners = {}
    for package in packages:
        folder = os.path.dirname(package["manifest_path"])
        for where, _, names in sorted(os.walk(folder)):
            for name in sorted(names):
                if re.match(r"(?i)(licen[sc]e|copying|notice|unlicense)", name) and not name.endswith(".rs"):
                    with open(os.path.join(where, name), errors="replace") as file:
                        owners.setdefault(file.read().strip(), []).append(f"{package['name']} {package['version']}")
    for text, names in owners.items():
        print("=" * 80)
        print(", ".join(dict.fromkeys(names)))
        print("=" * 80)
        print(text)
        print()
    silent = {f"{p['name']} {p['version']}": p for p in packages}
    for names in owners.values():
        for name in names:
            silent.pop(name, None)
    for name, package in silent.items():
        print(f"{name}: {package['license']}, by {', '.join(package['authors']) or 'its authors'}; it has no file of its licence.")


def main():
    what = sys.argv[1:]
    if what not in ([], ["--check"], ["--texts"]):
        sys.exit(__doc__)
    data = metadata()
    packages = shipped(data)
    # Tests and benches are held to the same rules, and so are boards.
    wrong = list(refused(from_elsewhere(data)))
    for pattern in OTHERS:
        manifests = sorted(glob.glob(pattern, root_dir=ROOT))
        if not manifests:
            sys.exit(f"third_party.py: {pattern} leads to no manifest")
        for manifest in manifests:
            wrong += (f"{manifest}: {text}" for text in refused(from_elsewhere(metadata(manifest))))
    if wrong:
        sys.exit("third_party.py:\n" + "\n".join(wrong))
    if what == ["--texts"]:
        texts(packages)
    elif what == ["--check"]:
        with open(NOTICES) as file:
            if file.read() != page(packages):
                sys.exit("THIRD-PARTY.md is not of this lock file; run tests/third_party.py")
    else:
        with open(NOTICES, "w") as file:
            file.write(page(packages))


main()
