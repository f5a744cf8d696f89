#!/usr/bin/env python3
"""Fails where a crate that the library itself depends on asks for a newer Rust than Cargo.toml states."""
import json
import subprocess
import sys


def version(text):
    return tuple(int(part) for part in (text.split(".") + ["0", "0"])[:3])


def main():
    metadata = json.loads(
        subprocess.run(
            ["cargo", "metadata", "--format-version", "1", "--locked", "--all-features"],
            check=True,
            stdout=subprocess.PIPE,
        ).stdout
    )
    packages = {package["id"]: package for package in metadata["packages"]}
    nodes = {node["id"]: node for node in metadata["resolve"]["nodes"]}
    root = metadata["resolve"]["root"]
    stated = version(packages[root]["rust_version"])

    # What an engine builds: dependencies that are not for development only.
    reached, to_visit = set(), [root]
    while to_visit:
        node = to_visit.pop()
        for dependency in nodes[node]["deps"]:
            kinds = {kind["kind"] for kind in dependency["dep_kinds"]}
            if kinds != {"dev"} and dependency["pkg"] not in reached:
                reached.add(dependency["pkg"])
                to_visit.append(dependency["pkg"])

    newer = [
        f"{packages[p]['name']} {packages[p]['version']} asks for {packages[p]['rust_version']}"
        for p in reached
        if packages[p]["rust_version"] and version(packages[p]["rust_version"]) > stated
    ]
    print(f"{len(reached)} dependencies, stated Rust version {packages[root]['rust_version']}")
    for line in newer:
        print(line)
    return 1 if newer else 0


if __name__ == "__main__":
    sys.exit(main())
