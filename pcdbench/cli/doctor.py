"""`pcdbench doctor`: what an issue report needs, and whether every dependency works on this machine."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

if TYPE_CHECKING:
    from pcdbench.doctor.examination import Finding

Format = Literal["text", "json"]


def doctor(format: Annotated[Format, typer.Option(help="How to print what it finds.")] = "text") -> None:
    """Print what an issue report needs, and test every dependency; exit code 1 where something is wrong."""
    from rich.console import Console

    from pcdbench.doctor.checks import CHECKS
    from pcdbench.doctor.examination import findings
    from pcdbench.doctor.installation import dependencies, installation

    facts = installation()
    names = [*CHECKS, *(name for name in dependencies() if name not in CHECKS)]
    found: list[Finding] = []
    with Console(stderr=True).status("") as status:
        checks = findings(names)
        for number, name in enumerate(names, 1):
            status.update(f"{name} ({number} of {len(names)})")
            found.append(next(checks))
    if format == "json":
        typer.echo(json.dumps(facts | {"checks": [vars(one) for one in found]}, indent=2))
    else:
        typer.echo("\n".join([*_facts(facts), "", "self-tests", *map(_line, found)]))
    if not all(one.ok for one in found) or facts["plugins"]["broken"] or facts["plugins"]["clashes"]:
        raise typer.Exit(1)


def _line(finding: Finding) -> str:
    return f"  {'ok   ' if finding.ok else 'WRONG'}  {finding.name:<14}  {finding.message}"


def _facts(facts: dict[str, Any]) -> list[str]:
    own, machine, plugins = facts["pcdbench"], facts["machine"], facts["plugins"]
    git = own["git"]
    commit = f", commit {git['commit'][:12]}{' and changes' if git['modified'] else ''}" if git else ""
    sizes = ", ".join(f"{name} {mb:,} MB" for name, mb in sorted(facts["cache"]["mb"].items()))
    return [
        f"pcdbench   {own['version']}{commit}, in {own['folder']}",
        f"python     {machine['python']} on {machine['platform']}",
        f"processor  {machine['cpu']}, {machine['cores']} cores, {machine['threads']} threads in use",
        f"memory     {machine['memory_gb']} GB",
        f"cache      {facts['cache']['folder']}: {sizes or 'empty'}",
        f"disk       {', '.join(f'{name} {free} GB free' for name, free in facts['free_disk_gb'].items())}",
        f"settings   {', '.join(f'{name}={value}' for name, value in facts['settings'].items()) or 'none'}",
        "",
        "packages",
        *(f"  {name} {version}" for name, version in facts["packages"].items()),
        "",
        "plugins",
        *(f"  {one['kind']} {one['name']}, of {one['origin']}" for one in plugins["found"]),
        *(f"  not loaded: {origin}: {error}" for origin, error in plugins["broken"].items()),
        *(f"  clash: {clash}" for clash in plugins["clashes"]),
    ]
