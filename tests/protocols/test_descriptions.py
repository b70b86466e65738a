"""Protocol descriptions: the built-in ones, one's own, and wrong ones, which are refused by file, key and reason."""

import copy
import re
import struct
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

import protocols
from protocols import (
    Command,
    DescriptionError,
    Frame,
    FrameDecoder,
    Other,
    PanoramaMessage,
    built_in_names,
    load_protocol,
    parse_protocol,
)
from protocols.checksum import CHECKSUMS
from protocols.description import (
    ArgumentDescription,
    CommandDescription,
    Description,
    FieldDescription,
    ItemDescription,
    MessageDescription,
)
from protocols.vocabulary import FORMS

DOCUMENT = Path(__file__).parents[2] / "docs" / "protocols.md"
V1 = (Path(protocols.__file__).parent / "panorama-v1.yaml").read_text(encoding="utf-8")


def example() -> str:
    found = re.search(r"```yaml\n(.*?)```", DOCUMENT.read_text(encoding="utf-8"), re.DOTALL)
    assert found
    return found[1]


def test_every_description_of_the_document_can_be_compiled() -> None:
    examples = re.findall(r"```yaml\n(.*?)```", DOCUMENT.read_text(encoding="utf-8"), re.DOTALL)
    names = [parse_protocol(text, "protocols.md").name for text in examples]
    assert names == [
        "example-sensor",
        "items-and-commands",
        "star-names",
        "every-key",
        "every-key-of-lines",
        "no-type-no-checksum",
        "panorama-v1-xxhash",
    ]


def test_the_examples_of_every_key_have_every_key() -> None:
    texts = re.findall(r"```yaml\n(version: 1\nname: every-key.*?)```", DOCUMENT.read_text(), re.DOTALL)
    assert len(texts) == 2
    models = (Description, MessageDescription, ItemDescription, CommandDescription, ArgumentDescription)
    for model in models:
        for key in set(model.model_fields) - {"extends"}:
            assert any(f"{key}:" in text for text in texts), key


def changed(old: str, new: str) -> str:
    assert old in V1
    text = V1 if "length: " in old + new else V1.replace("    length: 202\n", "")
    return text.replace(old, new, 1)


WRONG = {
    "an unknown type": (changed("type: u64", "type: u48"), "fields[0].type", "'u48'"),
    "an unknown key": (changed("length_limit", "lenght_limit"), "lenght_limit", "did you mean length_limit?"),
    "an unknown key of a field": (changed("unit: us", "units: us"), "fields[0].units", "did you mean unit?"),
    "a missing checksum": (changed("checksum: {name: crc32}", ""), "checksum", "is missing"),
    "a missing checksum name": (changed("{name: crc32}", "{}"), "checksum.name", "is missing"),
    "an unknown checksum name": (changed("{name: crc32}", "{name: crc31}"), "checksum.name", "expected one of crc32"),
    "overlapping fields": (
        changed("name: frame_no, type: u32", "name: frame_no, type: u32, offset: 4"),
        "PANORAMA.fields[1]",
        "overlaps time, which takes the bytes 0 to 7",
    ),
    "slots over fields": (changed("repeat: 30", "repeat: 30\n      offset: 21"), "PANORAMA.slots", "overlaps spare"),
    "a payload over the limit": (changed("limit: 1024", "limit: 201"), "PANORAMA.length", "202 bytes"),
    "a limit over the hard bound": (changed("limit: 1024", "limit: 65536"), "length_limit", "65535"),
    "a payload that the length field cannot say": (
        changed("length, type: u16", "length, type: u8, zero: 100"),
        "STATUS.length",
        "cannot be said",
    ),
    "a length that is not that of the fields": (changed("length: 202", "length: 200"), "PANORAMA.length", "202 bytes"),
    "a type code given twice": (changed("0x02", "0x01"), "STATUS.code", "the code of PANORAMA already"),
    "a type code that does not fit": (changed("0x02", "0x102"), "STATUS.code", "does not fit"),
    "a message given twice": (changed("  STOP:", "  PING:"), "messages.PING", "given twice"),
    "an unknown message": (changed("PANORAMA:", "PANORMA:"), "messages.PANORMA", "known are PANORAMA"),
    "an unknown field": (changed("name: frame_no", "name: frame"), "fields[1].name", "known here: time, fraction"),
    "a field given twice": (changed("name: frame_no, type: u32", "name: count, type: u32"), "fields[5].name", "twice"),
    "a missing field": (
        changed("{name: y, type: u16, unit: px}", "{name: spare, type: u16}"),
        "slots.fields",
        "y is missing",
    ),
    "a panorama without slots": (changed("slots:", "note: |"), "PANORAMA.slots", "is missing"),
    "slots where there are none": (
        changed("length: 32", "slots: {repeat: 1, fields: [{name: spare, type: u8}]}"),
        "STATUS.slots",
        "only PANORAMA",
    ),
    "a missing unit": (changed("unit: us, ", ""), "fields[0].unit", "expected one of ns, us, ms, s"),
    "a unit of another kind": (changed("unit: us", "unit: px"), "fields[0].unit", "'px'"),
    "a unit that makes no sense": (changed("{name: count, ", "{name: count, unit: px, "), "fields[5].unit", "has none"),
    "a scale of zero": (changed("scale: 1 ", "scale: 0 "), "scale", "every value the same"),
    "a scale that is not a number": (changed("scale: 1 ", "scale: one "), "scale", "1/32"),
    "a scale on a counter": (changed("{name: count, ", "{name: count, scale: 2, "), "fields[5].scale", "has none"),
    "a counter as a float": (changed("count, type: u8", "count, type: f32"), "fields[5].type", "integer"),
    "a minimum over the maximum": (changed("max: 4096", "max: 4096, min: 5000"), "fields[2].min", "4096"),
    "a bound that is not a number": (changed("max: 4096", "max: .nan"), "fields[2].max", "finite"),
    "a bit that the type does not have": (changed("3: clock reset", "16: clock reset"), "fields[3].bits", "16 does"),
    "a flag that the header does not have": (changed("0: stored", "8: stored"), "header[1].bits", "8 does not fit u8"),
    "a word that is none in YAML": (
        changed("1: acquired", "1: on"),
        "values[1]",
        "is a YAML word for true: put",
    ),
    "a word given twice": (changed("1: acquired", "1: lost"), "ATTITUDE.fields[6].values", "twice"),
    "a bound on bits": (changed("{name: status, ", "{name: status, max: 3, "), "fields[3].max", "has none"),
    "a unit on a spare field": (changed("{name: spare, ", "{name: spare, unit: us, "), "fields[6].unit", "has none"),
    "a header without type": (
        changed("  - {name: type, type: u8}\n", ""),
        "PANORAMA.code",
        "the header has no type",
    ),
    "a signed header field": (changed("name: type, type: u8", "name: type, type: i8"), "header[0].type", "unsigned"),
    "a header field that it does not know": (changed("name: flags", "name: origin"), "header[1].name", "known here"),
    "a sync word without quotes": (changed('"1ACFFC1D"', "12345678"), "framing.sync_word", "in quotes"),
    "a sync word that is not hexadecimal": (changed('"1ACFFC1D"', '"hello"'), "framing.sync_word", "hexadecimal"),
    "a sync word of one byte": (changed('"1ACFFC1D"', '"1A"'), "framing.sync_word", "2 to 8 bytes"),
    "no sync word": (changed(', sync_word: "1ACFFC1D"', ""), "framing.sync_word", "is missing"),
    "a sync word with SLIP": (changed("kind: sync", "kind: slip"), "framing.sync_word", "slip has none"),
    "an unknown framing": (changed("kind: sync", "kind: zip"), "framing.kind", "'zip': expected one of sync, length"),
    "an unknown byte order": (changed("order: big", "order: middle"), "byte_order", "'big' or 'little'"),
    "an unknown direction": (changed("from sensor", "up"), "PANORAMA.direction", "'up'"),
    "another version of the language": (changed("version: 1\n", "version: 2\n"), "version", "is 2"),
    "a mask with a gap": (changed("{name: status, type: u16", "{name: status, type: u16, mask: 5"), "mask", "a gap"),
    "a mask that does not fit": (
        changed("{name: status, type: u16", "{name: status, type: u16, mask: 0x10000"),
        "fields[3].mask",
        "does not fit u16",
    ),
    "slots by a count that is not there": (
        changed("{name: count, type: u8}", "{name: spare, type: u8}").replace(
            "repeat: 30", "count: count\n      most: 30"
        ),
        "PANORAMA.fields",
        "how many slots follow",
    ),
    "slots by count and repeat": (changed("repeat: 30", "repeat: 30\n      most: 30"), "slots", "count and most"),
    "slots by count with a length": (
        V1.replace("repeat: 30", "count: count\n      most: 30"),
        "PANORAMA.length",
        "leave it out",
    ),
    "parts without their fields": (
        changed("repeat: 30", "repeat: 30\n      parts: {first: 1}"),
        "slots.parts",
        "needs the fields part and parts",
    ),
    "a covered part that is not there": (
        changed("{name: crc32}", "{name: crc32, covers: {from: sequense}}"),
        "checksum.covers.from",
        "expected one of sync word",
    ),
    "a covered part that ends before it begins": (
        changed("{name: crc32}", "{name: crc32, covers: {from: length, to: type}}"),
        "checksum.covers.to",
        "before the begin",
    ),
    "a modulus over the bits of the number": (
        changed("length_limit", "sequence: {modulus: 65537}\nlength_limit"),
        "sequence.modulus",
        "16 bits",
    ),
    "a step that the modulus does not have": (
        changed("length_limit", "sequence: {modulus: 9, step: 2}\nlength_limit"),
        "sequence.step",
        "steps of 2",
    ),
    "addresses of a header without": (
        changed("length_limit", "addresses: {sensor: 1, host: 2}\nlength_limit"),
        "addresses",
        "no destination and source",
    ),
    "a destination without a source": (
        changed("{name: flags, type: u8, bits: {0: stored, 1: test}}", "{name: destination, type: u8}"),
        "header",
        "needs both",
    ),
    "a field of text in binary frames": (changed("count, type: u8", "count, type: decimal"), "fields[5].type", "bits"),
    "a word as a code in binary frames": (changed("code: 0x02", "code: STAT"), "STATUS.code", "expected a number"),
    "an end word of another framing": (
        changed("kind: sync", "kind: slip").replace('sync_word: "1ACFFC1D"', 'end_word: "0D0A"'),
        "framing.end_word",
        "slip has none",
    ),
    "a stuffed frame without an end": (
        changed('kind: sync, sync_word: "1ACFFC1D"', 'kind: stuffed, start: "1F7F", escape: "1F"'),
        "framing.end",
        "is missing",
    ),
    "a stuffed frame whose end is no escape": (
        changed('kind: sync, sync_word: "1ACFFC1D"', 'kind: stuffed, start: "1F7F", end: "2FFF", escape: "1F"'),
        "framing.end",
        "the escape 1F",
    ),
    "a time in floats and fractions": (
        changed(
            "{name: time, type: u64, unit: us",
            "{name: fraction, type: u8, unit: us}\n      - {name: time, type: f64, unit: us",
        ),
        "PANORAMA.fields",
        "whole numbers",
    ),
    "a fraction that makes no second": (
        changed(
            "{name: time, type: u64, unit: us",
            "{name: fraction, type: u8, unit: us, scale: 7/3}\n      - {name: time, type: u64, unit: us",
        ),
        "PANORAMA.fields",
        "the coarser",
    ),
    "no slots at all": (changed("repeat: 30", "repeat: 0"), "slots.repeat", "is 0"),
    "an ignored message with fields": (changed("length: 32", "ignored: true\n    length: 32"), "STATUS", "instead of"),
    "an unknown base": ("extends: panorama-v9\n", "extends", "expected one of attitude-quaternion"),
}


@pytest.mark.parametrize(("text", "key", "reason"), WRONG.values(), ids=WRONG)
def test_a_wrong_description_is_refused_by_file_key_and_reason(text: str, key: str, reason: str) -> None:
    with pytest.raises(DescriptionError) as refused:
        parse_protocol(text, "mine.yaml")
    first_line = str(refused.value).splitlines()[0]
    assert first_line.startswith("mine.yaml")
    assert f"{key}: " in first_line
    assert reason in first_line
    assert len(first_line) < 300


def test_the_line_of_the_mistake_is_named() -> None:
    text = changed("3: clock reset", "99: clock reset")
    line = next(n for n, row in enumerate(text.splitlines(), 1) if "99" in row)
    with pytest.raises(DescriptionError, match=rf"mine\.yaml, line {line}: "):
        parse_protocol(text, "mine.yaml")


@pytest.mark.parametrize(
    "text",
    [
        "",
        "just text",
        "[1, 2]",
        "a: [",
        "a: " + "[" * 5000,
        "x: " + "9" * 5000,
        "? {a: 1}\n: 2",
        "1: 2",
        "a: &x [1]\nb: *x",
        "!!python/object/apply:os.system [ls]",
        "\x00",
        "a" * 200_000,
        "[" * 90_000,
        "- " * 45_000,
        "messages: {PANORAMA: 5}",
        "extends: panorama-v1\nmessages: 5",
    ],
    ids=lambda text: repr(text[:20]),
)
def test_what_is_no_description_is_refused_in_few_lines(text: str) -> None:
    with pytest.raises(DescriptionError) as refused:
        parse_protocol(text, "odd.yaml")
    assert str(refused.value).startswith("odd.yaml")
    assert len(str(refused.value).splitlines()) <= 5
    assert len(str(refused.value)) < 1500


@pytest.mark.parametrize("name", ["no-such-protocol", "no/such/file.yaml", "/dev/zero", str(Path(__file__).parent)])
def test_what_cannot_be_read_is_refused_by_name(name: str) -> None:
    with pytest.raises(DescriptionError, match=name):
        load_protocol(name)


def test_a_file_that_is_not_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "binary.yaml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DescriptionError, match="UTF-8"):
        load_protocol(str(path))


def test_a_description_is_loaded_from_a_file_as_from_its_name(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(V1, encoding="utf-8")
    assert load_protocol(str(path)).encode(Command("PING"), 1) == load_protocol("panorama-v1").encode(
        Command("PING"), 1
    )


def test_the_text_of_a_protocol_makes_the_same_protocol_with_nothing_else() -> None:
    for name in built_in_names():
        first = load_protocol(name)
        assert "extends" not in yaml.safe_load(first.text)
        again = parse_protocol(first.text, "attachment")
        assert again.name == first.name == name
        assert again.frame_layout.sizes == first.frame_layout.sizes
        assert again.text == first.text


def test_one_may_extend_what_extends_another() -> None:
    mine = parse_protocol("extends: panorama-v1-subpixel\nname: mine\n", "mine.yaml")
    message = PanoramaMessage(1, 2, 0.1, frozenset(), 20.0, np.array([[1 / 32, 3.0]]), np.array([5.0]))
    assert mine.encode(message, 0) == load_protocol("panorama-v1-subpixel").encode(message, 0)


def test_fields_with_offsets_stand_where_they_say_in_any_order() -> None:
    text = changed(
        """      - {name: period, type: u32, unit: ms}""",
        """      - {name: spare, type: u16, offset: 6}
      - {name: period, type: u16, unit: ms, offset: 2}""",
    ).replace("direction: to sensor\n    length: 4", "direction: to sensor", 1)
    protocol = parse_protocol(text, "mine.yaml")
    assert protocol.encode(Command("START", {"period": 258}), 0)[10:-4] == bytes([0, 0, 1, 2, 0, 0, 0, 0])


def test_the_worked_example_of_the_document_reads_what_its_manual_says() -> None:
    protocol = parse_protocol(example(), "example.yaml")
    centroids = struct.pack("<HHH", 64 * 100 + 32, 64 * 200 + 48, 350) + struct.pack("<HHH", 32, 64, 400) + bytes(60)
    content = b"\xeb\x90" + struct.pack("<BB", 5, 88) + struct.pack("<IHHBB", 4711, 80, 2931, 7, 2) + centroids
    frame_bytes = content + struct.pack("<H", CHECKSUMS["crc16-modbus"].compute(content))
    [frame] = FrameDecoder(protocol).feed(frame_bytes)
    assert isinstance(frame, Frame)
    message = protocol.decode(frame)
    assert isinstance(message, PanoramaMessage)
    assert (message.time_us, message.exposure_s, frame.sequence) == (4_711_000, 0.08, -1)
    assert message.temperature_c == pytest.approx(19.95, abs=1e-9)
    assert message.xy_px.tolist() == [[100, 200.25], [0, 0.5]]
    assert message.index == pytest.approx([4096 - 2.56 * 350, 4096 - 2.56 * 400])
    assert message.problems == ()
    assert (protocol.slots, protocol.sequence_modulus) == (12, 0)
    assert protocol.encode(Command("START"), 0)[:4] == bytes([0xEB, 0x90, 0x70, 6])


def test_a_message_that_the_station_ignores_is_framed_and_given_as_bytes() -> None:
    protocol = parse_protocol(example(), "example.yaml")
    data = protocol.encode(Other("HOUSEKEEPING", bytes(range(20))), 0)
    [frame] = FrameDecoder(protocol).feed(data)
    assert isinstance(frame, Frame)
    assert protocol.decode(frame) == Other("HOUSEKEEPING", bytes(range(20)))


def test_the_document_names_every_key_checksum_message_field_and_unit() -> None:
    document = DOCUMENT.read_text(encoding="utf-8")
    fields = {name for form in FORMS.values() for name in (*form.roles, *form.slot_roles)}
    models = (Description, MessageDescription, ItemDescription, CommandDescription)
    words = {key for model in models for key in model.model_fields}
    for word in {*words, *fields, *CHECKSUMS, *FORMS, *built_in_names()}:
        assert f"`{word}`" in document, word
    for form in FORMS.values():
        for role in (*form.roles.values(), *form.slot_roles.values()):
            assert not role.units or ", ".join(role.units) in document


KEYS = st.sampled_from([*Description.model_fields, *MessageDescription.model_fields, *FieldDescription.model_fields])
LEAVES = st.one_of(st.none(), st.booleans(), st.integers(-(2**70), 2**70), st.floats(), st.text(max_size=8))


THREE_MESSAGES = yaml.safe_load(V1)
THREE_MESSAGES["messages"] = {name: THREE_MESSAGES["messages"][name] for name in ("PANORAMA", "NAK", "STOP")}


@given(data=st.data())
@settings(max_examples=80)
def test_a_description_with_anything_in_any_place_is_compiled_or_refused(data: st.DataObject) -> None:
    document = copy.deepcopy(THREE_MESSAGES)
    for _ in range(data.draw(st.integers(1, 3))):
        node = document
        while True:
            keys = list(node) if isinstance(node, dict) else list(range(len(node)))
            if not keys:
                break
            key = data.draw(st.sampled_from(keys))
            if isinstance(node[key], dict | list) and data.draw(st.booleans()):
                node = node[key]
                continue
            node[key] = data.draw(st.recursive(LEAVES, lambda s: st.lists(s, max_size=3) | st.dictionaries(KEYS, s)))
            break
    text = yaml.safe_dump(document, allow_unicode=True)
    try:
        protocol = parse_protocol(text, "odd.yaml")
    except DescriptionError:
        return
    FrameDecoder(protocol).feed(bytes(500))


@given(st.text(max_size=200))
def test_any_text_is_refused_as_a_description(text: str) -> None:
    with pytest.raises(DescriptionError):
        parse_protocol(text, "odd.yaml")
