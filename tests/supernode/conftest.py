"""What the tests of clients and of their commands share: a coordinator that the test plays, a job for it; a browser."""

import shutil

import pytest
from fake_service import FakeService


@pytest.fixture
def service():
    service = FakeService()
    yield service
    service.close()


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "sphere.toml"
    path.write_text('kind = "function"\nname = "sphere"\ndimension = 2\n')
    return path


@pytest.fixture(scope="module")  # while it lives, no other test of this process can have an asyncio loop
def chromium():
    sync_api = pytest.importorskip("playwright.sync_api")
    path = shutil.which("chromium")
    if path is None:
        pytest.skip("no chromium on this machine (Debian: apt-get install chromium)")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield browser
        browser.close()
