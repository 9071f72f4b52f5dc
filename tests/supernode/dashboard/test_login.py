"""Sessions: who gets one, what it allows, and when it ends."""

from http.cookies import SimpleCookie

import pytest

from supernode.dashboard import credentials
from supernode.dashboard.credentials import Credentials
from supernode.dashboard.limits import Limit

TOKEN, READER = "s3cret-s3cret-s3cret", "reader-reader-reader"
TOKENS = {TOKEN: "full", READER: "read"}
FORM = {"Content_Type": "application/x-www-form-urlencoded"}


@pytest.fixture
def shown(show):
    return show(TOKENS)


def cookie_of(headers):
    return headers["Set-Cookie"].partition(";")[0]


def test_the_login_page_and_what_it_shows_are_open_to_all(shown):
    status, _, page = shown.ask("GET", "/login")
    assert (status, 'action="/login"' in page, "/logout" in page) == (200, True, False)
    for path in ("style.css", "icon.svg"):
        assert shown.ask("GET", f"/static/{path}")[0] == 200


def test_a_token_becomes_a_cookie_that_scripts_and_other_sites_cannot_use(shown):
    status, headers, _ = shown.log_in(f" {TOKEN} ")
    assert (status, headers["Location"]) == (303, "/")
    ((name, cookie),) = SimpleCookie(headers["Set-Cookie"]).items()
    assert name == f"supernode_session_{shown.port}"
    assert (cookie["httponly"], cookie["samesite"], cookie["path"], cookie["secure"]) == (True, "strict", "/", "")
    assert TOKEN not in headers["Set-Cookie"]
    assert shown.ask("GET", "/", Cookie=cookie_of(headers))[0] == 200
    assert "Log out" in shown.ask("GET", "/", Cookie=cookie_of(headers))[2]


def test_over_tls_the_cookie_never_goes_without(show, certified):
    assert SimpleCookie(show(TOKENS, *certified()).log_in(TOKEN)[1]["Set-Cookie"]).popitem()[1]["secure"]


def test_so_it_is_where_a_proxy_speaks_tls(shown):
    _, headers, _ = shown.log_in(TOKEN, Host="dashboard.example", Origin="https://dashboard.example")
    assert SimpleCookie(headers["Set-Cookie"])["supernode_session"]["secure"]


def test_a_wrong_token_is_refused_on_the_page(shown):
    status, headers, page = shown.log_in("wrong-wrong-wrong-<b>")
    assert (status, "Set-Cookie" in headers) == (401, False)
    assert "not known here" in page
    assert "wrong-wrong" not in page


@pytest.mark.parametrize(
    ("then", "location"),
    [
        ("/compare?jobs=a%2Cb", "/compare?jobs=a%2Cb"),
        ("//evil.example/", "/evil.example/"),
        ("/\\evil.example", "/evil.example"),
        ("https://evil.example", "/https://evil.example"),
        ("/\t/evil.example", "/%09/evil.example"),
    ],
)
def test_it_leads_to_the_page_that_was_asked_for_and_never_to_another_site(shown, then, location):
    answer = shown.post("/login", {"token": TOKEN, "next": then})
    assert (answer[0], answer[1]["Location"]) == (303, location)


def test_no_other_site_logs_a_browser_in_or_out(shown):
    cookie = cookie_of(shown.log_in(TOKEN)[1])
    for headers in ({"Origin": "http://evil.example"}, {"Origin": "null"}, {"Sec_Fetch_Site": "cross-site"}):
        assert shown.log_in(TOKEN, **headers)[0] == 403
        assert shown.ask("POST", "/logout", "", Cookie=cookie, **headers)[0] == 403
    assert shown.ask("GET", "/logout", Cookie=cookie)[0] == 405
    assert shown.ask("GET", "/", Cookie=cookie)[0] == 200


@pytest.mark.parametrize("token", [TOKEN, READER])
def test_logging_out_ends_the_session_also_for_whoever_has_copied_it(shown, token):
    cookie, other = (cookie_of(shown.log_in(token)[1]) for _ in range(2))
    status, headers, _ = shown.ask("POST", "/logout", "", Cookie=cookie)
    assert (status, headers["Location"]) == (303, "/login")
    assert SimpleCookie(headers["Set-Cookie"]).popitem()[1]["max-age"] == "0"
    assert shown.ask("GET", "/", Cookie=cookie)[0] == 401
    assert shown.ask("GET", "/", Cookie=other)[0] == 200


def test_a_session_allows_what_its_token_allows(shown, service):
    cookie = cookie_of(shown.log_in(READER)[1])
    assert shown.ask("GET", "/jobs", Cookie=cookie)[0] == 200
    assert shown.post("/api/jobs", {"file": ""}, Cookie=cookie)[0] == 403
    cookie = cookie_of(shown.log_in(TOKEN)[1])
    assert shown.post("/api/jobs", {"file": ""}, Cookie=cookie)[0] == 400


def test_a_cookie_cannot_be_made_or_changed(shown):
    name, _, value = cookie_of(shown.log_in(TOKEN)[1]).partition("=")
    end, number, code = value.split(".")
    flipped = code[:-1] + ("0" if code[-1] != "0" else "1")
    for each in (
        "",
        "..",
        "x",
        f"{int(end) + 1}.{number}.{code}",
        f"{end}.{number}.{flipped}",
        f"{number}.{code}",
        "\xe9",
    ):
        assert shown.ask("GET", "/", Cookie=f"{name}={each}")[0] == 401


def test_what_is_sent_to_log_in_has_a_size_and_a_form(shown):
    assert shown.log_in("x" * 10_000)[0] == 413
    assert shown.ask("POST", "/login", "nothing", **FORM)[0] == 400
    assert shown.post("/login", {"token": 1})[0] == 400


def test_without_tokens_nobody_logs_in(show):
    shown = show()
    assert shown.log_in(TOKEN)[0] == 401
    assert "Log out" not in shown.ask("GET", "/")[2]


def test_a_session_ends_after_a_week(monkeypatch):
    known = Credentials(TOKENS, "key")
    cookie = known.begun(READER, "192.0.2.1")
    assert known.access_of_session(cookie) == "read"
    now = credentials.time.time()
    monkeypatch.setattr(credentials.time, "time", lambda: now + 7 * 24 * 3600 + 2)
    assert known.access_of_session(cookie) is None


def test_a_session_is_known_to_the_successor_of_the_same_run_and_dies_with_its_token():
    cookie = Credentials(TOKENS, "key").begun(TOKEN, "192.0.2.1")
    assert Credentials({TOKEN: "read"}, "key").access_of_session(cookie) == "read"
    assert Credentials({READER: "full"}, "key").access_of_session(cookie) is None
    assert Credentials(TOKENS, "other").access_of_session(cookie) is None


def test_sessions_that_were_ended_take_bounded_memory(monkeypatch):
    monkeypatch.setattr(credentials, "_KEPT", 2)
    known = Credentials(TOKENS, "key")
    for cookie in [known.begun(TOKEN, "192.0.2.1") for _ in range(3)]:
        known.end(cookie)
    known.end("none of ours")
    assert len(known._ended) == 2


def test_wrong_tokens_count_for_the_address_they_come_from():
    known = Credentials(TOKENS, "key")
    known._wrong = Limit(1e-3, 2, lambda: 0.0)
    for _ in range(2):
        assert known.access_of_token("wrong", "192.0.2.1") is None
    with pytest.raises(credentials.TooManyGuessesError) as refused:
        known.access_of_token(TOKEN, "192.0.2.1")
    assert refused.value.wait == pytest.approx(1000)
    assert known.access_of_token(TOKEN, "192.0.2.2") == "full"
