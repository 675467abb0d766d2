"""The server: who may ask, what is refused, and what it answers."""

import asyncio
import io
import json
import re
import threading
import zipfile
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from squares import COLORS, PLACES, SIDE, pair, photographs, quick, save, square

pytest.importorskip("starlette", reason='needs pip install "zpm2[app]"')

from asking import CLEARED, OWN, TOKEN, answer, asked, told

from zpm2 import MatchResult
from zpm2.app.export import region_of, result_of
from zpm2.app.server import Server
from zpm2.app.session import Session, made
from zpm2.app.turns import Replaced, Turns
from zpm2.errors import InputError
from zpm2.model import ImagePolygons, PointMatches, Polygon, PolygonMatch

MARKUP = "\"><script>document.title='pwned'</script>'.png"


def empty(most: float = 1e6) -> Server:
    return Server(made(quick(), lambda text: None), TOKEN, most)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Session:
    found = made(quick(), lambda text: None)
    found.open(*save(tmp_path_factory.mktemp("pair")))
    return found


@pytest.fixture(scope="module")
def server(session: Session) -> Server:
    return Server(session, TOKEN, 1e6)


def png(image: np.ndarray) -> bytes:
    file = io.BytesIO()
    PIL.Image.fromarray(image).save(file, "PNG")
    return file.getvalue()


def test_the_page_and_its_policy() -> None:
    app = empty().application
    page = asked(app, "/", headers=OWN)
    assert page.status == 200
    assert page.headers["cache-control"] == "no-store"
    assert page.headers["x-frame-options"] == "DENY"
    policy = page.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert TOKEN.encode() not in page.body
    text = page.body.decode()
    imports = json.loads(re.search(r'<script type="importmap">(.*?)</script>', text)[1])["imports"]
    for address in [*imports.values(), *re.findall(r'(?:src|href)="(/.*?)"', text)]:
        assert asked(app, address, headers=OWN).status == 200, address
    assert imports["#app/main.js"] == "/static/app/main.js"
    assert imports["#report/panel.js"] == "/static/report/panel.js"
    assert not re.findall(r"\son\w+=|style=", text)


@pytest.mark.parametrize("token", ["", TOKEN[:-1], TOKEN + "x", TOKEN.upper(), "\xe9"])
def test_a_wrong_token_is_refused(token: str) -> None:
    app = empty().application
    for path, body in (
        ("/api/state", None),
        ("/api/export", b"{}"),
        ("/api/photograph/left", b"x"),
        ("/api/none", None),
    ):
        found = asked(app, path, body, {**OWN, "x-zpm2-token": token})
        assert (found.status, "token" in found.error) == (401, True)
    assert asked(app, "/api/state", headers=OWN).status == 401
    assert asked(app, "/api/state?token=" + TOKEN, headers=OWN).status == 401
    assert asked(app, "/api/state").status == 200


@pytest.mark.parametrize(
    "host",
    ["evil.example", "evil.example:8000", "127.0.0.1.evil.example", "127.0.0.1@evil.example", "", "192.168.0.7", "["],
)
def test_another_name_of_this_machine_is_refused(host: str) -> None:
    """DNS rebinding: another page's name is pointed at this machine."""
    for path in ("/", "/api/state", "/static/app/main.js"):
        found = asked(empty().application, path, headers={**CLEARED, "host": host})
        assert found.status == 403
        assert "default-src 'none'" in found.headers["content-security-policy"]


def test_names_of_this_machine() -> None:
    session = made(quick(), lambda text: None)
    wide = Server(session, TOKEN, 1e6, names=["my-host"], any_address=True).application
    for host in ("127.0.0.1:9", "localhost:1", "[::1]:5", "MY-HOST:80", "192.168.0.7:8000"):
        assert asked(wide, "/api/state", headers={**CLEARED, "host": host}).status == 200
    assert asked(wide, "/", headers={"host": "evil.example"}).status == 403
    assert asked(wide, "/", headers={}).status == 403


def test_requests_of_other_pages_are_refused() -> None:
    app = empty().application
    foreign = [
        {"origin": each} for each in ("http://evil.example", "null", "http://127.0.0.1:9", "https://127.0.0.1:8000")
    ]
    foreign += [{"sec-fetch-site": each} for each in ("cross-site", "same-site")]
    for headers in foreign:
        assert asked(app, "/api/photograph/left", b"x", {**CLEARED, **headers}).status == 403
    assert asked(app, "/", headers={**OWN, "sec-fetch-site": "cross-site"}).status == 200  # a link was clicked
    own = {"origin": "http://127.0.0.1:8000", "sec-fetch-site": "same-origin"}
    assert asked(app, "/api/state", headers={**CLEARED, **own}).status == 200


@pytest.mark.parametrize(
    "path",
    [
        *("../../pyproject.toml", "app/../../errors.py", "..%2f..%2ferrors.py", "%2e%2e/errors.py", "/etc/passwd"),
        *(
            "app/app.html",
            "app/../app/main.js",
            "report/package.json",
            "..\\errors.py",
            "app//main.js",
            "app/main.js\x00",
        ),
        *("report/report.html", "", ".", "~/.ssh/id_rsa", "file:///etc/passwd"),
    ],
)
def test_no_path_leads_to_another_file(path: str) -> None:
    app = empty().application
    assert asked(app, f"/static/{path}").status == 404
    assert asked(app, f"/api/photograph/{path}").status == 404


def test_a_link_among_the_files_is_not_followed(tmp_path: Path, session: Session) -> None:
    """Names are those of a table that was made at the start."""
    app = Server(session, TOKEN, 1e6).application
    secret = tmp_path / "secret.js"
    secret.write_text("secret")
    (tmp_path / "link.js").symlink_to(secret)
    assert asked(app, f"/static/{tmp_path}/link.js").status == 404


def test_photographs_that_the_browser_sends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    server = empty()
    app = server.application
    left, right = (png(each.rgb) for each in photographs())
    assert asked(app, "/api/photograph/left").error == "there is no left photograph yet"
    assert asked(app, "/api/photograph/middle", left).status == 404
    first = asked(app, f"/api/photograph/left?name=a/../{MARKUP}", left)
    assert first.json["photographs"] == [{"name": MARKUP.rpartition("/")[2], "width": 320, "height": 240}, None]
    assert told(app, "/api/prepare", number=1).error.startswith("there are not two photographs")
    assert asked(app, "/api/photograph/right?name=C:\\secret\\b.png", right).json["photographs"][1]["name"] == "b.png"
    assert told(app, "/api/draw", number=1).error == "the photographs have changed: reload the page"
    shown = asked(app, "/api/photograph/left")
    assert shown.headers["content-type"] == "image/webp"
    seen = np.asarray(PIL.Image.open(io.BytesIO(shown.body)))
    assert np.abs(seen[PLACES[0][1] + 25, PLACES[0][0] + 25].astype(int) - COLORS[0]).max() < 20
    assert list(tmp_path.iterdir()) == []
    assert server.session.photographs[0].path is None


def test_what_is_no_photograph_is_one_line() -> None:
    app = empty(most=5000).application
    script = b"<svg xmlns='http://www.w3.org/2000/svg'><script>alert(1)</script></svg>"
    for content in (b"", b"no picture", png(np.zeros((8, 8, 3), np.uint8)), script, b"\x89PNG\r\n\x1a\n" + b"\0" * 99):
        found = asked(app, "/api/photograph/left?name=x.png", content)
        assert found.status == 400
        assert "x.png" in found.error
        assert "/" not in found.error.replace("damaged/", "")
    found = asyncio.run(answer(app, "/api/photograph/left", b"x" * 3000, more=b"x" * 3000))
    assert (found.status, "more than" in found.error, "--max-upload" in found.error) == (413, True, True)


def test_a_small_file_of_many_pixels_is_refused_before_it_is_decoded() -> None:
    file = io.BytesIO()
    PIL.Image.new("1", (16000, 16000)).save(file, "PNG")
    found = asked(empty().application, "/api/photograph/left?name=x.png", file.getvalue())
    assert found.error.startswith("x.png has 16000 x 16000 px, more than the 250 megapixels")


def test_what_is_no_request_is_one_line(server: Server) -> None:
    app = server.application
    number = server.session.number
    for body in (b"", b"[]", b"{", b"[" * 100_000, b"\xff", b'{"number": 1e999}'):
        assert asked(app, "/api/draw", body).status == 400
    for values in ({}, {"side": "up"}, {"side": "left"}, {"side": "left", "prompt": {"points": "x"}}):
        found = told(app, "/api/draw", number=number, **values)
        assert found.status == 400
        assert "\n" not in found.error
    assert told(app, "/api/export", number=number, regions=[{"label": 7}]).status == 400
    region = {"accepted": True, "left": square(0), "right": square(0, 1)}
    found = told(app, "/api/export", number=number, regions=[{**region, "label": "\ud800x"}], formats=[])
    assert (found.status, "the label '\\ud800x' has a character" in found.error) == (400, True)
    assert told(app, "/api/export", number=number, regions=[], formats=["../../x"]).status == 400
    assert asked(app, "/nothing").error == "there is nothing at this address"
    assert asked(app, "/api/state", b"").status == 405


def test_from_a_click_to_the_files(server: Server, session: Session, tmp_path: Path) -> None:
    app = server.application
    about = {"number": session.number, "region": "r1", "side": "left"}
    looked = told(app, "/api/prepare", **about).json
    assert np.median([a - c for a, _, c, _ in looked["points"]]) == pytest.approx(12, abs=0.5)
    x, y = PLACES[3]
    drawn = told(app, "/api/draw", **about, prompt={"points": [[x + SIDE / 2, y + SIDE / 2, 1]]}).json
    carried = told(app, "/api/carry", **about, parts=drawn["parts"]).json
    assert carried["status"] == "found"
    region = {"accepted": True, "left": drawn["parts"], "right": carried["parts"], "label": MARKUP, "agreement": 0.5}
    region |= {"visible": None, "points": carried["points"], "match": None}
    packed = told(app, "/api/export", number=session.number, regions=[region], formats=["coco", "labelme"])
    assert packed.headers["content-type"] == "application/zip"
    with zipfile.ZipFile(io.BytesIO(packed.body)) as file:
        assert file.namelist() == sorted(file.namelist())
        assert {each.date_time for each in file.infolist()} == {(1980, 1, 1, 0, 0, 0)}  # the same bytes each time
        file.extractall(tmp_path)
    names = {path.name for path in (tmp_path / "zpm2-app").iterdir()}
    assert names >= {"matches.json", "left.geojson", "overlay.png", "report.html"}
    assert names >= {"right.coco.json", "right.labelme.json"}
    result = MatchResult.load(tmp_path / "zpm2-app")
    (match,) = result.matches
    assert (match.confidence, result.left.polygons[0].label) == (1.0, MARKUP)
    assert abs(result.left.polygons[0].area - SIDE**2) < 200
    assert b"<script>document" not in (tmp_path / "zpm2-app" / "report.html").read_bytes()


def test_an_opened_result_keeps_what_nobody_touched(tmp_path: Path) -> None:
    files = save(tmp_path)
    sides = []
    for side, file in enumerate(files):
        shown = [Polygon(k, np.array(square(k, side)[0][0], float)) for k in range(4)]
        sides.append(ImagePolygons(320, 240, shown, str(file), unmatched={3: "no candidate"}))
    matches = [PolygonMatch(k, k, 0.5, 1.5, 3, "global", nodes=np.array([[0, 0]])) for k in range(3)]
    none = PointMatches.empty()
    given = MatchResult(*sides, matches, none, np.eye(3), np.eye(3), quick().to_dict(), {}, non_overlapping=True)
    given.save(tmp_path / "out")
    session = made(quick(), lambda text: None)
    session.open_result(tmp_path / "out")
    state = asked(Server(session, TOKEN, 1e6).application, "/api/state").json
    assert [each["match"] for each in state["regions"]] == [0, 1, 2]
    assert state["regions"][1]["right"] == [[[[float(x), float(y)] for x, y in square(1, 1)[0][0]]]]
    moved = [[[[x + 1, y] for x, y in square(2, 1)[0][0]]]]
    regions = [
        {"match": 0, "accepted": False},
        {"match": 2, "accepted": True, "left": square(2), "right": moved, "label": "roof", "agreement": 0.25},
        {"match": None, "accepted": True, "left": square(3), "right": square(3, 1), "label": None, "agreement": 1},
    ]
    message = {"number": session.number, "regions": regions, "formats": []}
    with zipfile.ZipFile(io.BytesIO(session.export(message))) as file:
        file.extractall(tmp_path)
    found = MatchResult.load(tmp_path / "zpm2-app")
    assert [(each.left, each.right, each.confidence) for each in found.matches] == [
        (1, 1, 0.5),
        (2, 2, 1.0),
        (4, 4, 1.0),
    ]
    assert len(found.matches[0].nodes) == 1
    assert len(found.matches[1].nodes) == 0
    assert found.left.unmatched == {3: "no candidate", 0: "rejected"}
    assert found.right.polygons[2].bounds[0] == PLACES[2][0] - 12 + 1
    assert found.left.polygons[2].label == "roof"
    assert not found.non_overlapping
    assert result_of(pair(), [region_of(regions[0])], given).non_overlapping
    with pytest.raises(InputError, match="no match 77"):
        session.export({**message, "regions": [{"match": 77, "accepted": True}]})


def test_a_result_without_its_photographs_is_refused(tmp_path: Path) -> None:
    session = made(quick(), lambda text: None)
    with pytest.raises(InputError, match=r"matches\.json"):
        session.open_result(tmp_path)


def test_one_at_a_time_and_the_newest_of_a_region() -> None:
    turns, order, first = Turns(), list[str](), threading.Event()

    def work(name: str) -> str:
        if name == "a1":
            first.wait(10)
        order.append(name)
        return name

    async def all_of_them() -> list[object]:
        begun = [
            asyncio.create_task(turns.newest(name[0], lambda name=name: work(name)))
            for name in ("a1", "a2", "b1", "a3")
        ]
        other = asyncio.create_task(turns.one(lambda: work("c")))
        await asyncio.sleep(0.05)
        first.set()
        return await asyncio.gather(*begun, other, return_exceptions=True)

    found = asyncio.run(all_of_them())
    turns.close()
    assert order == ["a1", "b1", "a3", "c"]
    assert isinstance(found[1], Replaced)
    assert [each for each in found if not isinstance(each, Replaced)] == order


def test_a_fault_is_told_without_its_inside(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server.session, "picture", lambda side: 1 / 0)

    async def ask() -> int:
        with pytest.raises(ZeroDivisionError):  # for the log
            await answer(server.application, "/api/photograph/left")
        return 0

    assert asyncio.run(ask()) == 0
