"""Downloads from a hub that breaks off, is busy, lies or has something else."""

import hashlib
import io

import pytest

from hub import COMMIT, Fault, Hub
from lexsplat_training.bundles import catalogue, download, files, licence
from lexsplat_training.bundles.catalogue import Entry, Source
from lexsplat_training.bundles.download import Digest
from lexsplat_training.bundles.lock import Lock
from lexsplat_training.command_line import InputError

REPO = "models/someone/net"
NAME = "weights.bin"


@pytest.fixture(autouse=True)
def no_pauses(monkeypatch):
    """Attempts follow at once; the pauses are collected."""
    pauses = []
    monkeypatch.setattr(download.time, "sleep", pauses.append)
    return pauses


@pytest.fixture
def served(tmp_path):
    """A hub with one large and one small file."""
    folder = tmp_path / "hub" / REPO
    folder.mkdir(parents=True)
    (folder / NAME).write_bytes(bytes(range(256)) * 40_000)
    (folder / "small.json").write_text("{}")
    with Hub(tmp_path / "hub") as hub:
        yield hub


def entry(*names, by_hand=""):
    sources = {"weights": Source(REPO, names or (NAME,), by_hand)}
    return Entry("net", "A net", "MIT", "Terms.", "page", 0.1, "none.txt", "clip", {}, sources)


def gather(served, folder, *names, **more):
    return files.gather(entry(*names, **more), served.address, folder, Lock(folder / "lock"))


def whole(served, path, name=NAME):
    return path.read_bytes() == (served.folder / REPO / name).read_bytes()


def test_a_broken_download_goes_on_where_it_broke(served, tmp_path):
    served.faults[NAME] = [Fault(cut=3_000_000), Fault(cut=0), Fault(cut=2_000_000)]
    path = gather(served, tmp_path)["weights"]
    assert whole(served, path)
    starts = [asked for _, asked in served.seen]
    assert starts == [None, "bytes=3000000-", "bytes=3000000-", "bytes=5000000-"]


def test_a_stopped_download_goes_on_in_another_run(served, tmp_path):
    served.faults[NAME] = [Fault(cut=4_000_000)] + [Fault(status=500)] * download.TRIES
    with pytest.raises(InputError, match=r"500.*gave up after 6 attempts, run the command again"):
        gather(served, tmp_path)
    assert not (tmp_path / NAME).exists() and not Lock(tmp_path / "lock").entries
    served.faults.clear()
    served.seen.clear()
    assert whole(served, gather(served, tmp_path)["weights"])
    assert served.seen == [(NAME, "bytes=4000000-")]


def test_a_server_without_ranges_is_asked_for_everything_again(served, tmp_path):
    served.faults[NAME] = [Fault(cut=3_000_000), Fault(no_range=True)]
    assert whole(served, gather(served, tmp_path)["weights"])


def test_a_busy_server_is_given_the_time_that_it_asks_for(served, tmp_path, no_pauses):
    served.faults[NAME] = [Fault(status=429, after="7"), Fault(status=503), Fault(status=503)]
    assert whole(served, gather(served, tmp_path)["weights"])
    assert no_pauses == [7, 2, 4]


def test_wrong_bytes_are_refused_and_deleted(served, tmp_path):
    served.faults[NAME] = [Fault(wrong=True)]
    with pytest.raises(InputError, match=r"weights.bin: expected sha256 .*, found .*deleted"):
        gather(served, tmp_path)
    assert not list(tmp_path.glob(f"{NAME}*"))
    assert whole(served, gather(served, tmp_path)["weights"])


@pytest.mark.parametrize(
    ("status", "says"), [(404, "no such file"), (403, "gated"), (401, "who asks")]
)
def test_a_refusal_is_explained_and_not_tried_again(served, tmp_path, status, says):
    served.faults[NAME] = [Fault(status=status)]
    with pytest.raises(InputError, match=rf"{says}.*{status}"):
        gather(served, tmp_path)
    assert len(served.seen) == 1


def test_a_hub_that_is_not_there_is_named(tmp_path):
    with pytest.raises(InputError, match=r"127.0.0.1:9/api.*refused.*gave up"):
        files.gather(entry(), "http://127.0.0.1:9", tmp_path, Lock(tmp_path / "lock"))


def test_the_first_download_locks_the_bytes(served, tmp_path):
    path = gather(served, tmp_path)["weights"]
    locked = Lock(tmp_path / "lock").find("net", "weights")
    assert (locked.repo, locked.revision, locked.path) == (REPO, COMMIT, NAME)
    assert locked.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    served.seen.clear()
    gather(served, tmp_path)
    assert not served.seen, "what is here already is not asked for"
    # The hub has other bytes now: refused, since the lock has those of the first time.
    path.unlink()
    (served.folder / REPO / NAME).write_bytes(bytes(10_240_000))
    with pytest.raises(InputError, match=locked.sha256):
        gather(served, tmp_path)


def test_a_damaged_copy_is_downloaded_again(served, tmp_path):
    path = gather(served, tmp_path)["weights"]
    path.write_bytes(path.read_bytes()[:-1] + b"x")
    assert whole(served, gather(served, tmp_path)["weights"])


def test_small_files_are_checked_by_gits_digest(served, tmp_path):
    assert whole(served, gather(served, tmp_path, "small.json")["weights"], "small.json")
    other = tmp_path / "other"
    other.mkdir()
    served.faults["small.json"] = [Fault(wrong=True)]
    with pytest.raises(InputError, match="expected git"):
        gather(served, other, "small.json")


def test_the_first_name_that_exists_is_taken_in_any_folder(served, tmp_path):
    deep = served.folder / REPO / "Pretrained"
    deep.mkdir()
    (deep / "b.bin").write_bytes(bytes(5000))
    assert gather(served, tmp_path, "a.bin", "b.bin", NAME)["weights"].name == "b.bin"
    with pytest.raises(InputError, match=r"expected c.bin or d.bin, found no such file"):
        gather(served, tmp_path / "none", "c.bin", "d.bin")


def test_a_file_that_the_hub_lacks_can_be_given_by_hand(served, tmp_path):
    with pytest.raises(InputError, match=rf"by.bin: the hub does not have it; ask.*{tmp_path}"):
        gather(served, tmp_path, "by.bin", by_hand="ask the authors")
    (tmp_path / "by.bin").write_bytes(b"weights")
    assert gather(served, tmp_path, "by.bin", by_hand="ask the authors")["weights"].exists()
    (tmp_path / "by.bin").write_bytes(b"other")
    with pytest.raises(InputError, match=r"by.bin: expected sha256"):
        gather(served, tmp_path, "by.bin", by_hand="ask the authors")


def test_too_little_disk_is_noticed_before(served, tmp_path, monkeypatch):
    usage = type("Usage", (), {"free": 1000})
    monkeypatch.setattr(download.shutil, "disk_usage", lambda _: usage)
    with pytest.raises(InputError, match="are missing, the disk has"):
        gather(served, tmp_path)
    assert not served.seen


def test_digests_are_those_of_git_and_sha256(tmp_path):
    (tmp_path / "file").write_bytes(b"what is up, doc?")
    # The blob of the book Pro Git.
    found = Digest("git", "").of(tmp_path / "file")
    assert found == "bd9dbf5aae1a3862dd1526723246b20206e5fc37"


@pytest.mark.parametrize(("answer", "accepts"), [("yes\n", True), ("no\n", False), ("", False)])
def test_a_licence_is_shown_and_asked_for(answer, accepts, monkeypatch, capsys):
    terminal = io.StringIO(answer)
    terminal.isatty = lambda: True
    monkeypatch.setattr("sys.stdin", terminal)
    if accepts:
        licence.ask(entry(), accepted=False)
    else:
        with pytest.raises(InputError, match="not accepted"):
            licence.ask(entry(), accepted=False)
    assert "Licence: MIT. Terms." in capsys.readouterr().out


def test_nobody_to_ask_is_a_refusal(monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO("yes\n"))
    with pytest.raises(InputError, match="--accept-licence"):
        licence.ask(entry(), accepted=False)
    licence.ask(entry(), accepted=True)


def test_the_catalogue_is_whole():
    entries = catalogue.read()
    assert set(entries) == {"paper", "openclip", "siglip2", "talk2dino"}
    for name, one in entries.items():
        assert one.licence and one.terms and one.page.startswith("https://"), name
        assert (catalogue.FILE.parents[2] / one.packages).exists(), name
        assert (catalogue.FILE.parent / f"from_{one.convert}.py").exists(), name
    with pytest.raises(InputError, match="found 'nope'; there are"):
        catalogue.entry("nope")
