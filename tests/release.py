#!/usr/bin/env python3
"""What can be checked of a release; docs/releasing.md has the rest.

    tests/release.py                        versions, lock files, changelog, metadata, workflows: in every run of tests/all.sh
    tests/release.py --tag v0.2.0           besides: the tag, a clean tree, THIRD-PARTY.md, the repository's address
    tests/release.py --notes                the changelog's section of this version, for the release's page
    tests/release.py --repository ADDRESS   writes the repository's address into the manifests, once there is one

Needs no network. A line for everything that is wrong, and exit code 1.
"""

import datetime
import os
import re
import subprocess
import sys
import tomllib
import xml.etree.ElementTree

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..")
# Crates of the registry, each after those that it needs.
PUBLISHED = ["protocol", "firmware", "forward", "inverse", "hil-sim"]
# Programs and packages of other lock files.
STANDALONE = ["fuzz"] + [f"boards/{n}" for n in ("emulator", "qemu-mps2", "stm32f4", "stm32h7", "template")]
ROS_PACKAGE = "contrib/ros2/skin_msgs/package.xml"
wrong = []


def require(holds, text):
    if not holds:
        wrong.append(text)


def text(path):
    with open(os.path.join(ROOT, path), encoding="utf-8") as file:
        return file.read()


def toml(path):
    return tomllib.loads(text(path))


def git(*arguments):
    return subprocess.run(["git", *arguments], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)


def dependencies(manifest):
    """All tables of dependencies, also those of one target, as pairs of name and entry."""
    for part in [manifest, *manifest.get("target", {}).values()]:
        for kind in ("dependencies", "dev-dependencies", "build-dependencies"):
            yield from ((kind, name, entry) for name, entry in part.get(kind, {}).items())


def versions(version, workspace):
    """One version everywhere, in manifests and lock files."""
    members = workspace["workspace"]["members"]
    for member in members:
        package = toml(f"{member}/Cargo.toml")["package"]
        require(package.get("version") == {"workspace": True}, f"{member}/Cargo.toml: version.workspace = true is missing")
    for name, entry in workspace["workspace"]["dependencies"].items():
        if name in PUBLISHED:
            require(entry.get("version") == version, f"Cargo.toml: {name} in [workspace.dependencies] is not of version {version}")
    for folder in STANDALONE:
        found = toml(f"{folder}/Cargo.toml")["package"]["version"]
        require(found == version, f"{folder}/Cargo.toml: version {found}, not {version}")
    boards = {f"boards/{n}" for n in os.listdir(os.path.join(ROOT, "boards")) if os.path.exists(os.path.join(ROOT, "boards", n, "Cargo.toml"))}
    require(boards <= set(STANDALONE), f"tests/release.py does not know {boards - set(STANDALONE)}")
    for folder in ["."] + STANDALONE:
        lock = toml(f"{folder}/Cargo.lock")["package"]
        for package in lock:
            if "source" not in package:
                require(package["version"] == version, f"{folder}/Cargo.lock: {package['name']} {package['version']}; cargo update --workspace")
        # Stale otherwise: every build of the tests has --locked, too.
        for member in members if folder == "." else [folder]:
            manifest = toml(f"{member}/Cargo.toml")
            locked = next((p for p in lock if p["name"] == manifest["package"]["name"]), {"dependencies": []})
            have = {d.split()[0] for d in locked.get("dependencies", [])}
            for kind, name, entry in dependencies(manifest):
                if isinstance(entry, dict) and entry.get("workspace"):
                    entry = workspace["workspace"]["dependencies"][name]
                real = entry.get("package", name) if isinstance(entry, dict) else name
                require(real in have, f"{folder}/Cargo.lock does not have {real} of {member}; cargo update --workspace")
    ros = xml.etree.ElementTree.parse(os.path.join(ROOT, ROS_PACKAGE)).findtext("version")
    require(ros == version, f"{ROS_PACKAGE}: version {ros}, not {version}")
    python = toml("python/pyproject.toml")["project"]
    require("version" in python["dynamic"], "python/pyproject.toml: the version has to be that of python/Cargo.toml (dynamic)")


def section(version):
    """Date and lines of a version in the changelog."""
    found = re.search(rf"^## {re.escape(version)} - (\S+)\n(.*?)(?=^## |\Z)", text("CHANGELOG.md"), re.M | re.S)
    return (found.group(1), found.group(2).strip()) if found else (None, "")


def changelog(version):
    date, notes = section(version)
    require(date, f"CHANGELOG.md has no section '## {version} - YEAR-MONTH-DAY'")
    if date:
        try:
            datetime.date.fromisoformat(date)
        except ValueError:
            wrong.append(f"CHANGELOG.md: {date} is no date")
        require(notes, f"CHANGELOG.md: the section of {version} is empty")
        first = re.search(r"^## (\d\S*)", text("CHANGELOG.md"), re.M).group(1)
        require(first == version, f"CHANGELOG.md: {first} stands above {version}")


def metadata(workspace):
    """What the registry asks for, of the five crates that are published."""
    known = {workspace["workspace"]["dependencies"][n].get("package") for n in PUBLISHED}
    for folder in PUBLISHED:
        manifest = toml(f"{folder}/Cargo.toml")
        package, name = manifest["package"], f"{folder}/Cargo.toml"
        require(package["name"] in known, f"{name}: {package['name']} is not its name in [workspace.dependencies]")
        require(package.get("publish", True) is True, f"{name}: publish = false")
        for key in ("description", "documentation", "license", "rust-version", "readme", "keywords", "categories", "include"):
            require(package.get(key), f"{name}: no {key}")
        keywords = package.get("keywords", [])
        require(len(keywords) <= 5 and all(re.fullmatch(r"[a-z][\w+-]{0,19}", k) for k in keywords), f"{name}: keywords")
        require(len(package.get("categories", [])) <= 5, f"{name}: more than five categories")
        for file in (package.get("readme", "README.md"), "LICENSE-MIT", "LICENSE-APACHE"):
            require(os.path.exists(os.path.join(ROOT, folder, file)), f"{folder}/{file} is missing")
        for kind, other, _ in dependencies(manifest):
            ours = os.path.exists(os.path.join(ROOT, other, "Cargo.toml"))
            earlier = other in PUBLISHED[: PUBLISHED.index(folder)]
            require(not ours or earlier, f"{name}: {other} ({kind}) is not published before {folder}")


def workflows(workspace):
    """What the workflows repeat of the manifests is the same there."""
    tests, release = text(".github/workflows/tests.yml"), text(".github/workflows/release.yml")
    rust = workspace["workspace"]["package"]["rust-version"]
    require(f'"{rust}"' in tests, f".github/workflows/tests.yml does not test Rust {rust}, the rust-version of Cargo.toml")
    published = "".join(f" -p skin-{n}" for n in PUBLISHED)
    for command in ("cargo publish --dry-run --locked", "cargo publish --locked"):
        require(command + published + "\n" in release, f".github/workflows/release.yml has no {command}{published}")
    require(f"FROM rust:{rust}" in text("contrib/docker/Dockerfile"), f"contrib/docker/Dockerfile is not built with Rust {rust}")
    for path in ["fuzz"] + STANDALONE:
        package = toml(f"{path}/Cargo.toml")["package"]
        require(package.get("rust-version", rust) == rust or path == "boards/emulator", f"{path}/Cargo.toml: another rust-version")


def tag(name, version, workspace):
    require(name == f"v{version}", f"the tag is {name}, the version {version}")
    require(git("status", "--porcelain").stdout == "", "the tree has changes that are not committed")
    require(git("rev-parse", f"{name}^{{commit}}").stdout == git("rev-parse", "HEAD").stdout, f"{name} is not the commit that is checked out")
    unreleased = re.search(r"^## Unreleased\n(.*?)(?=^## )", text("CHANGELOG.md"), re.M | re.S)
    require(not unreleased or not unreleased.group(1).strip(), "CHANGELOG.md: something is still unreleased")
    require(
        workspace["workspace"]["package"].get("repository"),
        "no repository in Cargo.toml, which the registry's pages would show: tests/release.py --repository ADDRESS",
    )
    require(subprocess.run([sys.executable, "tests/third_party.py", "--check"], cwd=ROOT).returncode == 0, "THIRD-PARTY.md")


def set_repository(address):
    """In one place, from which the crates and the Python package have it."""
    if not address.startswith("https://"):
        sys.exit("release.py: the address begins with https://")
    places = [("Cargo.toml", "[workspace.package]\n", f'repository = "{address}"\n')]
    places += [(f"{n}/Cargo.toml", "license.workspace = true\n", "repository.workspace = true\n") for n in [*PUBLISHED, "python"]]
    for path, after, line in places:
        old = re.sub(r"^repository\b.*\n", "", text(path), flags=re.M)
        if after not in old:
            sys.exit(f"release.py: {path} has no {after.strip()}")
        with open(os.path.join(ROOT, path), "w", encoding="utf-8") as file:
            file.write(old.replace(after, after + line, 1))


def main():
    arguments = sys.argv[1:]
    workspace = toml("Cargo.toml")
    version = workspace["workspace"]["package"]["version"]
    if arguments == ["--notes"]:
        print(section(version)[1])
        return
    if len(arguments) == 2 and arguments[0] == "--repository":
        set_repository(arguments[1])
        return
    if arguments and (len(arguments) != 2 or arguments[0] != "--tag"):
        sys.exit(__doc__)
    versions(version, workspace)
    changelog(version)
    metadata(workspace)
    workflows(workspace)
    if arguments:
        tag(arguments[1], version, workspace)
    if wrong:
        sys.exit("release.py:\n" + "\n".join(wrong))
    print(f"release.py: {version} can be released" + ("" if arguments else ", but for its tag"))


main()
