"""A robot on the page of its job, in a real browser."""

import pytest
from live_service import ROOT, address_in, live, until

SOLVED = 240  # s, for a first run on a busy machine, which compiles the kernels
DRAWN = "document.querySelector('.space')?.data ?? []"
VERTICES = f"[...({DRAWN}).find((each) => each.name === 'robot').x]"
EYE = "document.querySelector('.space').layout.scene.camera.eye.x"


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    with live(tmp_path_factory.mktemp("state"), "torus 1x2", "--dashboard", "127.0.0.1:0") as service:
        yield service


@pytest.fixture(scope="module")
def job(cluster):
    pytest.importorskip("pinocchio")
    with cluster.connect() as client:
        job = client.submit(ROOT / "examples" / "panda-shelf.toml", generations=10)
        job.answer(SOLVED)
        return job.id


@pytest.fixture
def page(page_of, cluster, job):
    home = address_in(cluster.line)
    page = page_of(home)
    page.goto(f"{home}jobs/{job}")
    until(lambda: page.evaluate(f"({DRAWN}).some((each) => each.name === 'robot')"))
    return page


def slid_to(page, step):
    page.evaluate(
        "(step) => { const slider = document.querySelector('.step input'); slider.value = step;"
        " slider.dispatchEvent(new Event('input')); }",
        step,
    )


def test_the_slider_moves_a_robot_that_can_be_turned(page):
    assert page.evaluate(f"({DRAWN}).filter((each) => each.type === 'mesh3d').map((each) => each.name)") == [
        "robot", "obstacle", "start", "goal"
    ]  # fmt: skip
    assert page.is_hidden("#scene")
    assert page.evaluate("[...document.querySelectorAll('#spaces canvas')].length") > 0
    at_start, eye = page.evaluate(VERTICES), page.evaluate(EYE)
    slid_to(page, 50)
    until(lambda: page.evaluate(VERTICES) != at_start)
    assert page.text_content(".step output").startswith("time ")
    page.focus(".space")
    page.keyboard.press("ArrowLeft")
    until(lambda: page.evaluate(EYE) != eye)


def test_a_better_solution_leaves_camera_and_slider(page):
    sizes = page.evaluate("""async () => {
      const { Moving } = await import("/static/moving.js");
      const job = document.getElementById("job").dataset.job, address = `/api/jobs/${job}`;
      const { animation } = await (await fetch(`${address}/spaces`)).json();
      const parent = document.getElementById("spaces"), moving = new Moving(parent, `${address}/bodies`);
      const asked = [], ask = window.fetch;
      window.fetch = (...told) => { asked.push(told[0]); return ask(...told); };
      await moving.show(animation, "one");
      moving.slider.value = 50;
      await Plotly.relayout(moving.plot, { "scene.camera.eye": { x: 2, y: 1, z: 1 } });
      const slower = animation.frames.flatMap((each) => [each, each]).slice(1), along = slower.map((_, index) => index);
      const curves = slower.map(() => animation.names.map(() => 0));
      await moving.show({ ...animation, frames: slower, along, curves, lines: [] }, "another");
      const fetched = asked.filter((each) => each.includes("/bodies")).length, { layout, data } = moving.plot;
      return [fetched, moving.step, layout.scene.camera.eye.x, data[0].x.length];
    }""")
    assert sizes[:3] == [1, 100, 2]
    assert sizes[3] > 1000
