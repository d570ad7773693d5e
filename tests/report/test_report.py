"""The page: whole, from the disk alone, and true to the numbers."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from report_material import RATES, REASONS, results

from geoprior.errors import DataError
from geoprior.report.report import Media, write_report

VOID = {"meta", "img", "br", "source", "link", "input", "hr"}
FETCHING = {"src", "href", "srcset", "poster", "data", "action", "xlink:href", "background", "formaction"}


class Page(HTMLParser):
    """Collects what a browser would fetch and checks that tags are closed in order."""

    def __init__(self, text):
        super().__init__()
        self.references, self.tags, self.images, self.text, self.open = [], [], [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.references += [value for name, value in attrs if name in FETCHING]
        if tag in {"img", "video"}:
            self.images.append(dict(attrs))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def write(out, material, **changes):
    arguments = {
        "results": results(),
        "config_text": material.config_text,
        "run": material.run,
        "media": material.media,
        "losses": material.losses,
    }
    return write_report(out=out, **{**arguments, **changes})


@pytest.fixture(scope="module")
def report(material, tmp_path_factory):
    path = write(tmp_path_factory.mktemp("run") / "report", material)
    return path, path.read_text(encoding="utf-8")


def words_of(text):
    return re.sub(r"\s+", " ", " ".join(Page(text).text)).replace("\u202f", " ")


def test_the_page_is_well_formed_html(report):
    page = Page(report[1])
    assert report[1].lstrip().startswith("<!DOCTYPE html>")
    assert page.open == []
    assert page.tags.count("main") == 1
    assert page.tags.count("h1") == 1


def test_the_page_fetches_nothing_from_outside_and_everything_is_there(report):
    path, text = report
    page = Page(text)
    assert page.references
    for reference in page.references:
        assert re.fullmatch(r"media/[A-Za-z0-9._-]+", reference), reference
        assert (path.parent / reference).stat().st_size > 0
    assert "url(" not in text
    assert "@import" not in text
    assert not re.search(r"(https?:)?//\w", text)
    assert not {"link", "iframe", "object", "embed", "base"} & set(page.tags)


def test_nothing_lies_in_media_that_the_page_does_not_show(report):
    path, text = report
    shown = {Path(reference).name for reference in Page(text).references}
    assert {file.name for file in (path.parent / "media").iterdir()} == shown


def test_media_are_copied_byte_by_byte(report, material):
    copies = {file.read_bytes() for file in (report[0].parent / "media").iterdir()}
    assert {media.path.read_bytes() for media in material.media} <= copies


def test_every_picture_and_film_says_what_it_shows(report):
    images = Page(report[1]).images
    assert all(image.get("alt") or image.get("aria-label") for image in images)
    films = [image for image in images if "controls" in image]
    assert len(films) == 4
    assert all(
        {"muted", "loop", "playsinline"} <= film.keys() and film["preload"] == "metadata" for film in films
    )


def test_the_table_holds_every_number(report):
    text = words_of(report[1])
    for condition in results()["groups"][0]["conditions"]:
        for point in condition["checkpoints"]:
            assert f"{int(100 * point['rate'] + 0.5)} % {point['successes']}/{point['trials']}" in text
            low, high = (int(100 * point["interval"][end] + 0.5) for end in ("low", "high"))
            assert f"{low} to {high} %" in text
    for reason in REASONS:
        assert reason in text


def test_the_peak_is_called_what_it_is(report):
    assert "Peak the best checkpoint, chosen in hindsight: reads high" in words_of(report[1])


def test_where_it_came_from(report):
    text = words_of(report[1])
    for fact in (
        "pretrain 2 min 11 s",
        "episodes 600",
        "mujoco 3.8.1",
        "Example CPU @ 2.1 GHz",
        "geoprior-torus 0.1",
    ):
        assert fact in text


def test_what_the_user_wrote_is_escaped(report):
    assert "note: a &lt;b&gt; &amp; c" in report[1]
    assert "Synthetic &lt;episodes&gt;" in report[1]
    assert "<b>" not in report[1]


def test_the_same_input_gives_the_same_bytes(report, material, tmp_path):
    again = write(tmp_path / "report", material)
    assert again.read_bytes() == report[0].read_bytes()
    for file in (again.parent / "media").iterdir():
        assert file.read_bytes() == (report[0].parent / "media" / file.name).read_bytes()


@pytest.mark.parametrize(("seeds", "said"), [((0,), True), (range(5), False)])
def test_one_seed_is_called_a_demonstration(tmp_path, material, seeds, said):
    page = write(tmp_path / "report", material, results=results(training_seeds=seeds, states=8))
    assert ("not the evidence" in words_of(page.read_text(encoding="utf-8"))) == said


def test_scratch_may_win(tmp_path, material):
    swapped = {"prior": RATES["scratch"], "scratch": RATES["prior"]}
    page = write(tmp_path / "report", material, results=results(swapped))
    assert "scratch is ahead" in words_of(page.read_text(encoding="utf-8"))


def test_with_results_alone_the_page_is_whole(tmp_path):
    page = write_report(out=tmp_path / "report", results=results(), config_text="seed: 0\n", run={})
    text = page.read_text(encoding="utf-8")
    assert Page(text).open == []
    for absent in ("Rollouts", "Training losses", "How it was made", "<script"):
        assert absent not in text


def test_one_condition_and_uneven_checkpoints_are_shown(tmp_path):
    uneven = {"black-images": {256: 0.5}, "prior": RATES["prior"], "scratch": {512: 0.5, 2048: 0.7}}
    for rates in (uneven, {"prior": {0: 1.0}}):
        page = write_report(out=tmp_path / "report", results=results(rates), config_text="", run={})
        assert Page(page.read_text(encoding="utf-8")).open == []


def test_two_robots_have_a_part_each(tmp_path):
    both = results()
    both["groups"] += results(robot="xarm7", seed=1)["groups"]
    page = Page(write_report(out=tmp_path, results=both, config_text="", run={}).read_text(encoding="utf-8"))
    assert page.tags.count("article") == 2
    assert {"media/learning-curve-ur5e-pick-plain.svg", "media/learning-curve-xarm7-pick-plain.svg"} <= set(
        page.references
    )


def test_a_second_report_leaves_nothing_of_the_first(tmp_path, material):
    write(tmp_path / "report", material)
    page = write(tmp_path / "report", material, media=[], losses={})
    assert sorted(file.name for file in (page.parent / "media").iterdir()) == [
        "learning-curve-ur5e-pick-plain-narrow.svg",
        "learning-curve-ur5e-pick-plain.svg",
    ]


def test_names_that_clash_or_are_odd_are_kept_apart(tmp_path, material):
    film = material.media[-1].path
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "a film?.webm").write_bytes(film.read_bytes() + folder.encode())
    media = [
        Media("rollouts", tmp_path / folder / "a film?.webm", "same", "film", "../x") for folder in ("a", "b")
    ]
    page = Page(write(tmp_path / "report", material, media=media).read_text(encoding="utf-8"))
    films = [reference for reference in page.references if reference.endswith(".webm")]
    assert len(set(films)) == 2
    assert {(tmp_path / "report" / name).read_bytes()[-1:] for name in films} == {b"a", b"b"}


def test_a_missing_film_is_named(tmp_path, material):
    media = [Media("rollouts", tmp_path / "gone.webm", "gone", "film")]
    with pytest.raises(DataError, match=r"gone\.webm"):
        write(tmp_path / "report", material, media=media)
    assert not (tmp_path / "report" / "index.html").exists()


def test_foreign_results_are_refused(tmp_path, material):
    with pytest.raises(DataError, match="schema_version"):
        write(tmp_path / "report", material, results={**results(), "schema_version": 9})


def test_a_folder_that_cannot_be_written_is_named(tmp_path, material):
    (tmp_path / "report").write_text("a file")
    with pytest.raises(DataError, match="cannot be written"):
        write(tmp_path / "report", material)


def test_damaged_lines_of_a_log_are_said(tmp_path, material):
    log = tmp_path / "log.jsonl"
    log.write_text(json.dumps({"step": 1, "epoch": 1, "l1": 0.5}) + '\n{"st')
    page = write(tmp_path / "report", material, losses={"pretrain": log})
    assert "Damaged lines of the logs left out: 1." in words_of(page.read_text(encoding="utf-8"))
