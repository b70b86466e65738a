"""``gse ports``: the serial ports of this computer, with the programs that hold them."""

import json
from dataclasses import asdict
from typing import Any

import click

from drivers.ports import PortInfo, holders, is_accessible, line_in_use, ports_here


@click.command("ports")
@click.option("--json", "as_json", is_flag=True, help="One JSON object on stdout.")
def command(as_json: bool) -> None:
    """List the serial ports with their description and the program that holds each.

    A device name (/dev/ttyUSB0) is that of whichever adapter comes first. In a station file give the name that stays,
    which is shown below it, or a part of the description: hwgrep://FT232 finds the adapter under any device name.
    """
    found = [_facts(port) for port in ports_here()]
    if as_json:
        click.echo(json.dumps({"schema": "gse.ports/1", "ports": found}))
        return
    for facts in found:
        click.echo(f"{facts['device']:<16} {_text(facts)}")
        if facts["url_that_stays"]:
            click.echo(f"{'':<16} port.url: {facts['url_that_stays']}")
    if not found:
        click.echo("no serial ports found: plug in the adapter, or use the simulated sensor sim://", err=True)


def _facts(port: PortInfo) -> dict[str, Any]:
    held_by = holders(port.device)
    line = line_in_use(port.device) if held_by else None
    state = {"holders": held_by, "line": line, "accessible": is_accessible(port.device)}
    return asdict(port) | {"url_that_stays": port.url_that_stays} | state


def _text(facts: dict[str, Any]) -> str:
    parts = [facts["description"] or "no description"]
    if facts["vid"] is not None:
        parts.append(f"USB {facts['vid']:04x}:{facts['pid']:04x} serial number {facts['serial_number'] or 'none'}")
    at = f" at {facts['line']}" if facts["line"] else ""
    parts.append(f"held by {', '.join(facts['holders'])}{at}" if facts["holders"] else "free")
    if not facts["accessible"]:
        parts.append(
            "no permission: add your user to the group of the device (sudo usermod -aG GROUP USER), then log in again"
        )
    return "; ".join(parts)
