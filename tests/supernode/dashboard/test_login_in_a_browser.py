"""Logging in and out with a real browser, over TLS."""

import pytest

import supernode
from wire import jobs as wire

TOKEN, READER = "s3cret-s3cret-s3cret", "reader-reader-reader"
SIZES = [(1280, 800), (390, 844)]


@pytest.fixture
def shown(show, service, certified, file):
    service.submitted(wire.Submit(supernode.load(file).to_json(), "mine", 0))
    service.tell("mine", "running")
    return show({TOKEN: "full", READER: "read"}, *certified())


@pytest.fixture
def page(chromium, shown):
    """A page of a browser that has no cookies, and takes a certificate that nobody has signed."""
    context = chromium.new_context(ignore_https_errors=True)
    page = context.new_page()
    page.complaints = []
    page.on("console", lambda message: page.complaints.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: page.complaints.append(str(error)))
    yield page
    context.close()


def log_in(page, token):
    page.fill("input[name=token]", token)
    page.click("main button")


def test_whoever_has_a_token_for_reading_looks_at_all_and_logs_out(page, shown):
    page.goto(shown.home + "jobs")
    assert page.url == shown.home + "login?next=/jobs"
    log_in(page, READER)
    page.wait_for_selector("tr:has(a[href='/jobs/mine']) td[data-state=running]")
    assert page.url == shown.home + "jobs"
    assert page.query_selector("form#submit, button[aria-label='cancel mine']") is None
    page.wait_for_selector("main >> text=neither submit nor cancel")
    ((name, secure, only_http),) = [(each["name"], each["secure"], each["httpOnly"]) for each in page.context.cookies()]
    assert (name, secure, only_http) == (f"supernode_session_{shown.port}", True, True)
    page.goto(shown.home + "jobs/mine")
    page.wait_for_selector("#facts >> text=running")
    page.wait_for_selector("#convergence .main-svg")
    assert page.query_selector("#cancel") is None
    assert page.complaints == []
    page.click("text=Log out")  # a request of the page that is under way then may still be refused
    page.wait_for_selector("input[name=token]")
    assert page.context.cookies() == []
    page.goto(shown.home)
    assert page.url == shown.home + "login"
    assert {each for each in page.complaints if "401 (Unauthorized)" not in each} == set()


def test_whoever_has_a_full_token_submits_and_cancels(page, shown, service):
    page.goto(shown.home)
    log_in(page, TOKEN)
    page.wait_for_selector("#link[data-state=answers]")
    page.goto(shown.home + "jobs")
    page.click("button[aria-label='cancel mine']")
    page.wait_for_selector("tr:has(a[href='/jobs/mine']) td[data-state=cancelled]")
    page.fill("textarea[name=file]", 'kind = "function"\nname = "onemax"\ndimension = 8\n')
    page.click("form#submit button")
    page.wait_for_url("**/jobs/*")
    assert len(service.jobs) == 2
    assert page.complaints == []


@pytest.mark.parametrize("size", SIZES)
def test_the_login_page_fits_and_says_what_is_wrong(page, shown, size):
    page.set_viewport_size({"width": size[0], "height": size[1]})
    page.goto(shown.home)
    assert page.evaluate("document.activeElement.name") == "token"
    log_in(page, "wrong-wrong-wrong-wrong")
    page.wait_for_selector("#trouble >> text=not known here")
    assert page.evaluate("document.documentElement.scrollWidth") <= size[0]


def test_a_page_whose_session_has_ended_says_so(page, shown):
    page.goto(shown.home)
    log_in(page, READER)
    page.wait_for_selector("#link[data-state=answers]")
    page.context.clear_cookies()
    page.route("**/events", lambda route: route.abort(), times=1)
    page.evaluate("document.dispatchEvent(new Event('visibilitychange'))")  # opens the stream anew
    page.wait_for_selector("#link >> text=logged out")
