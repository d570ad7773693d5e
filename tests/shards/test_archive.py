import io
import tarfile

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geoprior.errors import DataError
from geoprior.shards.archive import ArchiveWriter, read_members

NAME = st.text("abz019_-", min_size=1, max_size=12)
SAMPLES = st.dictionaries(
    NAME,
    st.dictionaries(st.sampled_from(["json", "pose.npy", "hand.000000.png"]), st.binary(max_size=1500)),
    max_size=4,
)


def our_tar(samples):
    parts = []
    archive = ArchiveWriter(parts.append)
    for key, members in samples.items():
        for suffix in sorted(members):
            archive.add(f"{key}.{suffix}", members[suffix])
    archive.close()
    return b"".join(parts)


@pytest.fixture(scope="session")
def webdataset_tar():
    webdataset = pytest.importorskip("webdataset")

    def write(samples):
        file = io.BytesIO()
        with webdataset.TarWriter(file, user="geoprior", group="geoprior", mtime=0, encoder=False) as writer:
            for key, members in samples.items():
                writer.write({"__key__": key, **members})
        return file.getvalue()

    return write


@settings(max_examples=60)
@given(samples=SAMPLES)
def test_the_bytes_are_those_of_webdataset(webdataset_tar, samples):
    assert our_tar(samples) == webdataset_tar(samples)


def test_the_longest_name_and_a_large_member_too(webdataset_tar):
    samples = {"k" * 95: {"json": b"x" * 3_000_000}}
    assert our_tar(samples) == webdataset_tar(samples)


def test_names_that_do_not_fit_are_refused():
    archive = ArchiveWriter(lambda _: None)
    with pytest.raises(ValueError, match="longer than 100"):
        archive.add("k" * 101, b"")
    with pytest.raises(ValueError, match="ascii"):
        archive.add("é.json", b"")


def write_standard(path, tar_format, name):
    with tarfile.open(path, "w", format=tar_format) as archive:
        folder = tarfile.TarInfo("folder")
        folder.type = tarfile.DIRTYPE
        archive.addfile(folder)
        for number in range(3):
            info = tarfile.TarInfo(f"{name}{number}.json")
            info.size, info.mtime = 700 * number, 1.5
            archive.addfile(info, io.BytesIO(bytes(info.size)))


@pytest.mark.parametrize("tar_format", [tarfile.USTAR_FORMAT, tarfile.GNU_FORMAT, tarfile.PAX_FORMAT])
@pytest.mark.parametrize("name", ["short", "long/" + 120 * "n"])
def test_tars_of_other_programs_are_read(tmp_path, tar_format, name):
    if tar_format == tarfile.USTAR_FORMAT and len(name) > 100:
        name = "p" * 90 + "/" + "n" * 40
    path = tmp_path / "other.tar"
    write_standard(path, tar_format, name)
    with tarfile.open(path) as archive:
        expected = [(info.name, info.offset_data, info.size) for info in archive if info.isreg()]
    assert read_members(path) == expected
    assert len(expected) == 3


def test_every_cut_is_noticed(tmp_path):
    data = our_tar({"a": {"json": b"x" * 700, "pose.npy": b"y" * 10}, "b": {"json": b"z" * 512}})
    path = tmp_path / "cut.tar"
    path.write_bytes(data)
    members = read_members(path)
    end = members[-1].offset + 512
    for size in [*range(0, end + 512, 128), end - 1, end + 511]:
        path.write_bytes(data[:size])
        with pytest.raises(DataError, match=r"cut off|end mark|not a tar"):
            read_members(path)


@pytest.mark.parametrize("tar_format", [tarfile.GNU_FORMAT, tarfile.PAX_FORMAT])
def test_every_cut_of_a_foreign_tar_is_noticed(tmp_path, tar_format):
    path = tmp_path / "cut.tar"
    write_standard(path, tar_format, "long/" + 120 * "n")
    data, last = path.read_bytes(), read_members(path)[-1]
    end = last.offset + (last.size + 511) // 512 * 512
    for size in range(512, end + 512, 512):
        path.write_bytes(data[:size])
        with pytest.raises(DataError):
            read_members(path)


@pytest.mark.parametrize("content", [b"hello", bytes(range(256)) * 8, b"\x1f\x8b" + bytes(2000)])
def test_what_is_not_a_tar_is_named(tmp_path, content):
    path = tmp_path / "other.tar"
    path.write_bytes(content)
    with pytest.raises(DataError, match=r"other\.tar: (not a tar|cut off)"):
        read_members(path)


@pytest.mark.parametrize("size", [b"-0000001000\0", b"0000000010x\0", b"00000000090\0", bytes(12)])
def test_a_size_that_is_none_is_refused(tmp_path, size):
    """A negative one would send the reader round in a circle."""
    data = bytearray(our_tar({"a": {"json": b"x"}}))
    data[124:136] = size
    path = tmp_path / "crafted.tar"
    path.write_bytes(data)
    with pytest.raises(DataError, match=r"crafted\.tar: "):
        read_members(path)


@pytest.mark.parametrize("size", [b"-0000001000\0", b"\xff" * 10 + b"\xfe\x00"])
def test_a_negative_size_in_a_foreign_tar_is_refused(tmp_path, size):
    path = tmp_path / "crafted.tar"
    write_standard(path, tarfile.GNU_FORMAT, "long/" + 120 * "n")
    last = read_members(path)[-1]
    data = bytearray(path.read_bytes())
    header = last.offset - 512
    data[header + 124 : header + 136] = size
    data[header + 148 : header + 156] = b" " * 8
    data[header + 148 : header + 156] = b"%06o\0 " % sum(data[header : header + 512])
    path.write_bytes(data)
    with pytest.raises(DataError, match=r"crafted\.tar: "):
        read_members(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(DataError, match=r"none\.tar: no such file"):
        read_members(tmp_path / "none.tar")
