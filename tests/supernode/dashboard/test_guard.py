"""Who may come in, and what else a dashboard does not let be done to it."""

import threading
from urllib.parse import quote

import pytest
from live_service import until

from supernode.dashboard import data, guard, parsing
from supernode.dashboard.limits import Limit

TOKEN, READER = "s3cret-s3cret-s3cret", "reader-reader-reader"
TOKENS = {TOKEN: "full", READER: "read"}
PROBLEM = {"file": 'kind = "function"\nname = "onemax"\ndimension = 8\n'}


def own(shown):
    return f"http://127.0.0.1:{shown.port}"


def test_what_changes_anything_must_come_from_its_own_pages(shown, service):
    for headers in (
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": f"http://127.0.0.1:{shown.port + 1}"},
        {"Sec_Fetch_Site": "cross-site"},
    ):
        status, _, text = shown.post("/api/jobs", PROBLEM, **headers)
        assert (status, "another site" in text) == (403, True)
    assert service.jobs == {}
    until(lambda: shown.post("/api/jobs", PROBLEM, Origin=own(shown))[0] == 201)  # once it has met the cluster


def test_a_name_that_was_made_to_lead_here_is_refused(shown):
    assert shown.ask("GET", "/", Host="evil.example")[0] == 421
    assert shown.ask("GET", "/", Host="[broken")[0] == 421
    assert shown.ask("GET", "/", Host=f"localhost:{shown.port}")[0] == 200


def test_behind_a_proxy_it_has_the_proxys_name_and_needs_a_token(show, service):
    shown = show(TOKENS)
    assert shown.ask("GET", "/", Host="dashboard.example")[0] == 401
    token = {"Authorization": f"Bearer {TOKEN}", "Host": "dashboard.example"}
    assert shown.ask("GET", "/", **token)[0] == 200
    assert shown.post("/api/jobs", PROBLEM, Origin="https://evil.example", **token)[0] == 403
    until(lambda: shown.post("/api/jobs", PROBLEM, Origin="https://dashboard.example", **token)[0] == 201)


def test_browsers_are_told_to_load_nothing_from_elsewhere(shown):
    _, headers, _ = shown.ask("GET", "/")
    assert headers["Content-Security-Policy"].startswith("default-src 'self'")
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Cross-Origin-Opener-Policy"] == "same-origin"
    assert headers["Permissions-Policy"].startswith("camera=()")
    assert headers["Referrer-Policy"] == "same-origin"
    assert "Strict-Transport-Security" not in headers


def test_over_tls_they_are_told_to_come_by_tls_only_and_its_pages_have_its_scheme(show, service, certified):
    shown = show({}, *certified())
    assert shown.home == f"https://127.0.0.1:{shown.port}/"
    assert shown.ask("GET", "/")[1]["Strict-Transport-Security"] == "max-age=31536000"
    host = f"localhost:{shown.port}"  # where other servers may be that have no TLS
    assert "Strict-Transport-Security" not in shown.ask("GET", "/", Host=host)[1]
    assert shown.post("/api/jobs", PROBLEM, Origin=own(shown))[0] == 403
    until(lambda: shown.post("/api/jobs", PROBLEM, Origin=shown.home.rstrip("/"))[0] == 201)


def test_so_they_are_where_the_dashboard_breaks(shown, monkeypatch, capsys):
    monkeypatch.setattr(shown.dashboard.view, "node", lambda _: 1 / 0)
    status, headers, _ = shown.ask("GET", "/api/nodes/0")
    assert status == 500
    assert headers["Content-Security-Policy"].startswith("default-src 'self'")


@pytest.mark.parametrize(
    "path", ["/static/../server.py", "/static/%2e%2e/server.py", "/static/..%2fserver.py", "/../etc/passwd", "/static/"]
)
def test_paths_lead_to_no_other_files(shown, path):
    assert shown.ask("GET", path)[0] == 404


def test_a_token_is_needed_where_there_is_one(show):
    shown = show(TOKENS)
    for path in ("/", "/events", "/static/common.js", f"/?token={TOKEN}", "/api/jobs/x", "/metrics"):
        status, headers, _ = shown.ask("GET", path)
        assert (status, headers["WWW-Authenticate"]) == (401, "Bearer"), path
    assert shown.ask("GET", "/", Authorization="Bearer wrong")[0] == 401
    assert shown.ask("GET", "/", Authorization=TOKEN)[0] == 401
    assert shown.post("/api/jobs?token=" + TOKEN, PROBLEM)[0] == 401
    assert shown.post("/logout", {})[0] == 401
    for scheme in ("Bearer", "bearer"):
        assert shown.ask("GET", "/", Authorization=f"{scheme} {TOKEN}")[0] == 200
    assert shown.ask("GET", "/healthz")[0] in (200, 503)


def test_a_browser_is_led_to_the_login_page_and_only_where_it_opens_a_page(show):
    shown, accept = show(TOKENS), {"Accept": "text/html,*/*;q=0.8"}
    for path, login in (
        ("/", "/login"),
        ("/compare?jobs=a%2Cb", "/login?next=/compare%3Fjobs%3Da%252Cb"),
        ("//evil.example", "/login?next=//evil.example"),
    ):
        status, headers, _ = shown.ask("GET", path, **accept)
        assert (status, headers["Location"]) == (303, login)
    assert shown.post("/api/jobs", PROBLEM, **accept)[0] == 401


def test_a_token_for_reading_sees_all_and_changes_nothing(show, service):
    shown, token = show(TOKENS), {"Authorization": f"Bearer {READER}"}
    for path in ("/jobs/{job}/cancel", "/jobs"):
        status, _, text = shown.post("/api" + path, PROBLEM, **token)
        assert (status, "for reading only" in text) == (403, True)
    for method in ("PUT", "DELETE", "PATCH", "OPTIONS"):
        assert shown.ask(method, "/api/jobs/mine", **token)[0] == 403
    assert service.jobs == {}
    _, _, page = shown.ask("GET", "/jobs", **token)
    assert ("<textarea" in page, "neither submit nor cancel" in page) == (False, True)
    assert 'id="cancel"' not in shown.ask("GET", "/jobs/mine", **token)[2]
    full = {"Authorization": f"Bearer {TOKEN}"}
    assert "<textarea" in shown.ask("GET", "/jobs", **full)[2]
    assert 'id="cancel"' in shown.ask("GET", "/jobs/mine", **full)[2]
    until(lambda: shown.post("/api/jobs", PROBLEM, **full)[0] == 201)


def test_a_foreign_page_can_lead_here_but_have_nothing_loaded(shown):
    for site in ("cross-site", "same-site"):
        assert shown.ask("GET", "/", Sec_Fetch_Site=site, Sec_Fetch_Mode="navigate")[0] == 200
        for path in ("/events", "/jobs", "/static/common.js"):
            assert shown.ask("GET", path, Sec_Fetch_Site=site, Sec_Fetch_Mode="no-cors")[0] == 403
    assert shown.ask("GET", "/", Sec_Fetch_Site="same-origin", Sec_Fetch_Mode="no-cors")[0] == 200


def test_an_address_that_asks_too_often_is_told_to_wait(show, monkeypatch):
    monkeypatch.setattr(guard, "_REQUESTS_AT_ONCE", 3)
    monkeypatch.setattr(guard, "_REQUESTS_A_SECOND", 1e-3)
    shown = show(TOKENS)
    assert [shown.ask("GET", "/login")[0] for _ in range(3)] == [200] * 3
    status, headers, _ = shown.ask("GET", "/login", Authorization=f"Bearer {TOKEN}")
    assert (status, 900 < int(headers["Retry-After"]) <= 1000) == (429, True)


def test_after_wrong_tokens_none_is_looked_at_but_sessions_go_on(show, monkeypatch):
    shown = show(TOKENS)
    cookie = shown.log_in(TOKEN)[1]["Set-Cookie"].partition(";")[0]
    monkeypatch.setattr(shown.credentials, "_wrong", Limit(1e-3, 3))
    assert [shown.ask("GET", "/", Authorization=f"Bearer wrong{n}")[0] for n in range(3)] == [401] * 3
    for token in ("wrong", TOKEN):
        status, headers, _ = shown.ask("GET", "/", Authorization=f"Bearer {token}")
        assert (status, 900 < int(headers["Retry-After"]) <= 1000) == (429, True)
        status, headers, page = shown.log_in(token)
        assert (status, "Set-Cookie" in headers, "Too many wrong tokens" in page) == (429, False, True)
    assert shown.ask("GET", "/", Cookie=cookie)[0] == 200


def test_two_on_one_host_have_their_own_cookies(show):
    one, other = show(TOKENS), show({TOKEN[::-1]: "full"})
    cookies = [
        each.log_in(token)[1]["Set-Cookie"].partition(";")[0] for each, token in ((one, TOKEN), (other, TOKEN[::-1]))
    ]
    assert [each.ask("GET", "/", Cookie="; ".join(cookies))[0] for each in (one, other)] == [200, 200]


def test_others_are_served_while_a_text_made_to_take_hours_is_read(shown, monkeypatch):
    monkeypatch.setattr(parsing, "_WITHIN", 2)
    answers = []
    text = ".".join("a" * 250_000) + " = 1"
    posting = threading.Thread(target=lambda: answers.append(shown.post("/api/jobs", {"file": text})))
    posting.start()
    pages = 0
    while posting.is_alive():
        assert shown.ask("GET", "/")[0] == 200
        pages += 1
        posting.join(0.05)  # an address may not ask as often as it can
    ((status, _, said),) = answers
    assert (status, "expected TOML that can be read within 2 s" in said) == (400, True)
    assert pages > 2


def test_news_are_only_read(shown):
    assert shown.post("/events", {})[0] == 405


def test_what_is_submitted_has_a_size(shown, monkeypatch):
    monkeypatch.setattr(data, "_MOST_BODY", 1000)
    assert shown.post("/api/jobs", {"file": "#" * 2000})[0] == 413


@pytest.mark.parametrize(
    ("kind", "body", "status"),
    [
        ("application/json", "{", 400),
        ("application/json", "[1]", 400),
        ("application/json", "[" * 100_000, 400),
        ("application/json", '{"file": 1}', 400),
        ("application/json", '{"file": "kind = 3"}', 400),
        ("application/json", '{"file": "kind = \\"arm-ik\\"", "extra": 1}', 400),
        ("application/json", '{"file": "kind = \\"arm-ik\\"", "seed": "x"}', 400),
        ("application/json", '{"file": "kind = \\"arm-ik\\"", "seed": Infinity}', 400),
        ("application/json", '{"file": "kind = \\"arm-ik\\"", "seed": 1.0}', 400),
        ("application/json", '{"file": "kind = \\"arm-ik\\"", "seconds": NaN}', 400),
        ("application/json", '{"file": "kind = \\"arm-ik\\"", "seconds": 1' + 400 * "0" + "}", 400),
        ("application/json", '{"file": "kind = \\"arm-ik\\"", "priority": 1.9}', 400),
        ("application/json", '{"file": "kind = \\"arm-ik\\"", "priority": true}', 400),
        ("application/json", '{"file": "kind = \\"arm-ik\\"", "priority": 1' + 30 * "0" + "}", 400),
        ("application/json", '{"file": "kind = \\"arm-ik\\"", "name": "\\ud800"}', 400),
        ("application/json", '{"file": "kind = \\"arm-ik\\"", "name": "' + 201 * "n" + '"}', 400),
        ("application/json", '{"file": "kind = \\"\\ud800\\""}', 400),
        ("application/json", '{"\\ud800": 1}', 400),
        ("application/json", b"\xff\xfe", 400),
        ("application/x-www-form-urlencoded", "nothing", 400),
        ("text/plain", "{}", 415),
    ],
)
def test_what_is_malformed_is_refused(shown, kind, body, status):
    found, _, text = shown.ask("POST", "/api/jobs", body, Content_Type=kind)
    assert found == status
    assert "error" in text


@pytest.mark.parametrize("after", ["1" + 30 * "0", "-1", "1.5", "x", "\u0661"])
def test_records_are_asked_for_after_a_number(shown, service, after):
    until(lambda: shown.ask("GET", "/healthz")[0] == 200)
    assert shown.ask("GET", f"/api/jobs/x/history?improvements={quote(after)}")[0] == 400


def test_names_in_an_address_are_text(shown):
    status, _, page = shown.ask("GET", "/jobs/%3Cscript%3Ealert(1)%3C%2Fscript%3E")
    assert status in (200, 404)
    assert "<script>alert" not in page
    assert "<b>" not in shown.ask("GET", "/jobs/%3Cb%3E")[2]
