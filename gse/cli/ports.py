"""``gse ports``: the serial ports of this computer, and who holds them."""

import json
from dataclasses import asdict
from typing import Any

import click

from drivers.ports import PortInfo, holders, is_accessible, ports_here


@click.command("ports")
@click.option("--json", "as_json", is_flag=True, help="One JSON object on stdout.")
def command(as_json: bool) -> None:
    """List the serial ports, what each says of itself, and which program holds it.

    A port can be named by its device, or by what it says of itself: hwgrep://FT232 finds it under any name.
    """
    found = [_facts(port) for port in ports_here()]
    if as_json:
        click.echo(json.dumps({"schema": "gse.ports/1", "ports": found}))
        return
    for facts in found:
        click.echo(f"{facts['device']:<16} {_text(facts)}")
    if not found:
        click.echo("no serial ports: is the adapter plugged in? sim:// needs none", err=True)


def _facts(port: PortInfo) -> dict[str, Any]:
    return asdict(port) | {"holders": holders(port.device), "accessible": is_accessible(port.device)}


def _text(facts: dict[str, Any]) -> str:
    parts = [facts["description"]]
    if facts["vid"] is not None:
        parts.append(f"USB {facts['vid']:04x}:{facts['pid']:04x} serial number {facts['serial_number'] or 'none'}")
    parts.append(f"held by {', '.join(facts['holders'])}" if facts["holders"] else "free")
    if not facts["accessible"]:
        parts.append("no permission: join its group (usermod -aG), then log in again")
    return "; ".join(parts)
