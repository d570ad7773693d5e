from __future__ import annotations

import json
from dataclasses import asdict, replace

import pytest

from geoprior.errors import DataError
from geoprior.sim.records import TrialRecord, append_record, read_records, write_records

RECORD = TrialRecord(
    robot="ur5e",
    task="pick",
    condition="prior",
    training_seed=0,
    epoch=256,
    state_seed=1_000_000,
    success=False,
    reason="time-out",
    steps=100,
    seconds=10.0,
)


def test_records_round_trip_in_order(tmp_path):
    path = tmp_path / "rollouts.jsonl"
    assert read_records(path) == []
    later = replace(RECORD, condition="scratch")
    for record in (later, RECORD):
        append_record(path, record)
    assert read_records(path) == [later, RECORD]
    write_records(path, read_records(path))
    assert read_records(path) == [RECORD, later]


@pytest.mark.parametrize("cut", [1, 20, 120])
def test_half_written_last_line_is_cut_off(tmp_path, cut):
    path = tmp_path / "rollouts.jsonl"
    append_record(path, RECORD)
    whole = path.read_bytes()
    path.write_bytes(whole + whole[:cut])
    assert read_records(path) == [RECORD]
    assert path.read_bytes() == whole
    append_record(path, replace(RECORD, epoch=512))
    assert [record.epoch for record in read_records(path)] == [256, 512]


@pytest.mark.parametrize("line", [b"{}\n", b"[]\n", b"not json\n", b'{"robot": "ur5e"}\n', b"\xff\n"])
def test_foreign_line_is_named(tmp_path, line):
    path = tmp_path / "rollouts.jsonl"
    append_record(path, RECORD)
    path.write_bytes(path.read_bytes() + line)
    with pytest.raises(DataError, match=r"rollouts\.jsonl:2"):
        read_records(path)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("film", "/etc/passwd"),
        ("film", "films/../../secret.webm"),
        ("film", "films/x.txt"),
        ("success", 1),
        ("epoch", -1),
        ("seconds", None),
    ],
)
def test_what_a_stranger_wrote_is_checked(tmp_path, key, value):
    path = tmp_path / "rollouts.jsonl"
    path.write_text(json.dumps({**asdict(RECORD), key: value}) + "\n")
    with pytest.raises(DataError, match=rf"rollouts\.jsonl:1: {key}"):
        read_records(path)


def test_a_film_beside_the_records_may_be_named(tmp_path):
    path = tmp_path / "rollouts.jsonl"
    names = ("prior", "größe", "same-environment")
    filmed = [
        replace(RECORD, condition=name, film=f"films/{name}-s0-epoch-000096-state-3000000.webm")
        for name in names
    ]
    for record in filmed:
        append_record(path, record)
    assert read_records(path) == filmed
