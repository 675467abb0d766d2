"""The layers of a result, and styles that know all values which zpm2 writes."""

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import get_args

from zpm2_processing.results import STYLES, layers_of

from zpm2.carry.outcome import Status
from zpm2.linking import links
from zpm2.local_match.unmatched import REASONS as UNMATCHED
from zpm2.view.overlay import REASONS as COLORS


def made(folder: Path, *names: str) -> Path:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()
    return folder


def test_layers_of_each_command(tmp_path: Path) -> None:
    match = made(tmp_path / "m", "matches.gpkg", "matches.json", "left.geojson")
    assert [(layer.output, layer.source, layer.name) for layer in layers_of(match)] == [
        ("LEFT", f"{match / 'matches.gpkg'}|layername=left", "m: left"),
        ("RIGHT", f"{match / 'matches.gpkg'}|layername=right", "m: right"),
    ]
    link = made(tmp_path / "l", "links.json", "regions.gpkg", "shifts.geojson")
    assert [(layer.output, layer.name) for layer in layers_of(link)] == [
        ("SHIFTS", "l: shifts"),
        ("REGIONS", "l: linked"),
    ]
    carry = made(tmp_path / "c", *(f"{right}/{name}" for right in "ab" for name in ("carry.json", "regions.geojson")))
    assert [layer.name for layer in layers_of(carry)] == ["a: carried", "b: carried"]
    assert [layer.name for layer in layers_of(carry / "b")] == ["b: carried"]  # the folder of one photograph
    assert layers_of(made(tmp_path / "other", "regions.gpkg")) == []
    assert layers_of(tmp_path / "nothing") == []
    for layer in (*layers_of(match), *layers_of(link), *layers_of(carry)):
        assert layer.style.is_file()


def style(name: str) -> ElementTree.Element:
    return ElementTree.parse(STYLES / f"{name}.qml").getroot()


def rules(name: str) -> dict[str, str]:
    """Filter -> symbol; each rule has a symbol of its own."""
    root = style(name)
    found = {rule.attrib["filter"]: rule.attrib["symbol"] for rule in root.iter("rule")}
    assert sorted(found.values()) == sorted(symbol.attrib["name"] for symbol in root.findall("renderer-v2/symbols/*"))
    return found


def color(name: str, symbol: str) -> tuple[int, ...]:
    fill = style(name).find(f"renderer-v2/symbols/symbol[@name='{symbol}']/layer[@class='SimpleFill']/Option")
    assert fill is not None
    value = next(option.attrib["value"] for option in fill if option.attrib["name"] == "outline_color")
    return tuple(int(part) for part in value.split(",")[:3])


def values(name: str, column: str) -> set[str]:
    return {match[1] for rule in rules(name) if (match := re.match(rf"\"{column}\" = '([^']*)'", rule))}


def test_each_value_of_a_result_has_a_rule() -> None:
    assert values("matched", "unmatched") == set(UNMATCHED)
    reasons = {links.NOTHING, links.OUTSIDE, links.TAKEN, links.UNLIKE, links.PART}
    assert values("linked", "zpm2_unmatched") == reasons
    assert (
        values("carried", "zpm2_status") == {"found", "in part"} < set(get_args(Status))
    )  # the others have no outline
    for name in ("matched", "carried", "linked"):
        assert "ELSE" in rules(name)


def test_reasons_have_the_colours_of_the_picture() -> None:
    for reason, expected in COLORS.items():
        assert color("matched", rules("matched")[f"\"unmatched\" = '{reason}'"]) == expected
