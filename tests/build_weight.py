#!/usr/bin/env python3
"""What every direct dependency costs in a build, from cargo's timing report.

    time cargo build --release -p host --timings       (with an empty target folder)
    tests/build_weight.py [REPORT [CPU_SECONDS]]

REPORT is target/cargo-timings/cargo-timing.html unless said. With CPU_SECONDS, the user time of that build, the
durations of the report are scaled to sum to it: on a busy machine they are waiting times. Two weights for every
dependency: what would go if nothing of the workspace named it, and with all that it drags in, shared or not.
"""

import json
import re
import subprocess
import sys


def main():
    report = sys.argv[1] if len(sys.argv) > 1 else "target/cargo-timings/cargo-timing.html"
    with open(report) as file:
        units = json.loads(re.search(r"const UNIT_DATA = (\[.*?\]);\n", file.read(), re.S).group(1))
    total = sum(unit["duration"] for unit in units)
    scale = float(sys.argv[2]) / total if len(sys.argv) > 2 else 1.0
    weight = {}
    for unit in units:
        key = (unit["name"], unit["version"])
        weight[key] = weight.get(key, 0.0) + scale * unit["duration"]

    host = re.search(r"^host: (.*)$", subprocess.check_output(["rustc", "-vV"], text=True), re.M).group(1)
    command = ["cargo", "metadata", "--format-version", "1", "--filter-platform", host]
    metadata = json.loads(subprocess.check_output(command))
    name = {p["id"]: (p["name"], p["version"]) for p in metadata["packages"]}
    own = set(metadata["workspace_members"])
    needs = {
        node["id"]: [d["pkg"] for d in node["deps"] if any(k["kind"] != "dev" for k in d["dep_kinds"])]
        for node in metadata["resolve"]["nodes"]
    }
    start = [package for package in own if name[package] in weight]

    def reached(roots, without=None):
        """What is built for these packages, if the workspace did not name one of the dependencies."""
        found, todo = set(), list(roots)
        while todo:
            package = todo.pop()
            if package not in found:
                found.add(package)
                todo += [d for d in needs[package] if package not in own or d != without]
        return found

    def seconds(packages):
        return sum(weight.get(name[package], 0.0) for package in packages)

    everything = reached(start)
    print(f"{scale * total:.0f} s, {len({name[p] for p in everything if name[p] in weight})} crates")
    print("\n| crate of the workspace | s |\n|---|---|")
    for package in sorted(own & everything, key=lambda p: -seconds([p])):
        print(f"| {name[package][0]} | {seconds([package]):.1f} |")
    print("\n| dependency | alone, s | with all, s | named by |\n|---|---|---|---|")
    direct = {d for package in own & everything for d in needs[package]} - own
    for package in sorted(direct, key=lambda p: -seconds(everything - reached(start, p))):
        alone = seconds(everything - reached(start, package))
        users = sorted(name[user][0] for user in own & everything if package in needs[user])
        print(f"| {name[package][0]} | {alone:.1f} | {seconds(reached([package])):.1f} | {', '.join(users)} |")


if __name__ == "__main__":
    main()
