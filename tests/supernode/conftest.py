"""What the tests of clients and of their commands share: a coordinator that the test plays, and a job for it."""

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
