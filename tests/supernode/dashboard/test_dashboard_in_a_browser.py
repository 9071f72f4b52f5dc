"""The dashboard of a real cluster, in a real browser."""

import contextlib
import json
import os
import select
import signal
import subprocess
import sys
import urllib.error
import urllib.parse
import urllib.request
from pathlib import Path

import pytest
from live_service import ROOT, address_in, command_of, live, until

import supernode
from wire import jobs as wire
from wire.news import Improvement

# Nobody solves this: it runs until it is cancelled.
ENDLESS = """
kind = "function"
name = "rastrigin"
dimension = 200
[run]
topology = "torus 4x4"
mode = "async"
target = -1.0
stall = 1000000
seconds = 100
"""
SIZES = [(1280, 800), (390, 844)]


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    with live(tmp_path_factory.mktemp("state"), "torus 4x4", "--dashboard", "127.0.0.1:0") as service:
        yield service


@pytest.fixture(scope="module")
def home(cluster):
    return address_in(cluster.line)


@pytest.fixture
def endless(cluster, tmp_path):
    path = tmp_path / "endless.toml"
    path.write_text(ENDLESS)
    with cluster.connect() as client:
        job = client.submit(path)
        yield job
        job.cancel()
        job.result(30)


@pytest.fixture
def page(page_of, home):
    return page_of(home)


def see(page, selector, seconds=30):
    """Wait until there is such an element, seen or not."""
    page.wait_for_selector(selector, state="attached", timeout=1000 * seconds)


def dashboard_of(service):
    """The process id, whichever thread of `up` started it."""
    tasks = Path(f"/proc/{service.process.pid}/task")
    children = [int(each) for task in tasks.iterdir() for each in (task / "children").read_text().split()]
    return next((each for each in children if "supernode.dashboard" in command_of(each)), None)


def answers(address):
    with contextlib.suppress(OSError), urllib.request.urlopen(address + "healthz", timeout=10) as answer:
        return answer.status == 200
    return False


@pytest.mark.parametrize("size", SIZES)
def test_each_page_loads_and_fits(page, home, cluster, size):
    page.set_viewport_size({"width": size[0], "height": size[1]})
    with cluster.connect() as client:
        job = client.submit(ROOT / "examples" / "arm-ik.toml", seconds=5)
        job.result(60)
    for path in ("", "jobs", f"jobs/{job.id}", f"compare?jobs={job.id}"):
        page.goto(home + path)
        page.wait_for_selector("#link[data-state=answers]")
        assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
    page.wait_for_selector("#seconds .main-svg")
    page.wait_for_selector(f"#table >> text={job.id}")


def test_only_pages_that_show_nodes_are_sent_them(page, home, cluster, endless):
    streams = []
    page.on("request", lambda request: streams.append(request.url) if "/events" in request.url else None)
    for path, query in (("", ""), (f"jobs/{endless.id}", ""), ("jobs", "?nodes=0"), ("compare", "?nodes=0")):
        streams.clear()
        page.goto(home + path)
        see(page, '#link[data-state="answers"]')  # a snapshot was shown
        assert streams == [f"{home}events{query}"]


def test_cells_change_while_a_job_runs(page, home, endless):
    page.goto(home)
    page.select_option("#what", "sent")
    page.wait_for_selector("[data-cell='15'][fill^=rgb]")
    fills = "[...document.querySelectorAll('#torus rect')].map((each) => each.getAttribute('fill')).join()"
    before = page.evaluate(fills)
    until(lambda: page.evaluate(fills) != before)


def test_the_keyboard_leads_to_a_node(page, home, endless):
    page.goto(home)
    page.wait_for_selector("[data-cell='15']")
    page.focus("#torus")
    see(page, "#visited >> text=/^node 0, alive/")
    page.keyboard.press("ArrowRight")
    see(page, "#visited >> text=/^node 1, alive/")
    page.keyboard.press("Enter")
    see(page, "#node-title >> text=Node 1")
    page.wait_for_selector("#node >> text=generation")
    page.click("#all summary")
    page.wait_for_selector("#rows tr:nth-child(16)")


def test_a_killed_node_is_dead_within_five_seconds_and_alive_again(page, home, cluster, endless):
    page.goto(home)
    see(page, "[data-cell='5'][data-state=alive]")
    os.kill(cluster.processes()["node 5"], signal.SIGKILL)
    see(page, "[data-cell='5'][data-state=dead]", 5)
    see(page, "[data-cell='5'][data-state=alive]")
    page.wait_for_selector("#lines >> text=node 5 is alive again")


def test_a_form_leads_to_a_solved_job_with_its_scene(page, home):
    page.goto(home + "jobs")
    page.fill("textarea[name=file]", (ROOT / "examples" / "arm-ik.toml").read_text())
    page.fill("input[name=name]", "<img src=/nowhere onerror=alert(1)>.toml")
    page.fill("input[name=seconds]", "20")
    page.click("form#submit button")
    page.wait_for_selector("#facts >> text=solved")
    until(lambda: page.evaluate("document.getElementById('scene').naturalWidth") > 0)
    page.wait_for_selector("#convergence .main-svg .scatterlayer .trace .point")
    assert "<img src=/nowhere" in page.inner_text("#facts")
    assert page.query_selector("#facts img") is None


def test_a_job_that_has_ended_shows_what_happened(page, home, cluster):
    with cluster.connect() as client:
        job = client.submit(ROOT / "examples" / "arm-ik.toml", seconds=20)
        job.answer(60)
    page.goto(home + f"jobs/{job.id}")
    see(page, ".births circle")
    see(page, "#rows tr td:nth-child(4):not(:text-is('–'))")  # evaluations: what the cells noted, not what was heard
    page.wait_for_selector("#legend >> text=the job has ended")
    page.wait_for_selector("#facts div:has(dt:text-is('feasible')) >> text=yes")
    assert page.query_selector("#facts div:has(dt:text-is('evaluations')) dd:text-is('–')") is None
    see(page, "#convergence[aria-label*='now: verified']")
    assert page.inner_text("#trouble") == ""


FACTS = """() => Object.fromEntries([...document.querySelectorAll('#facts div')].map((each) =>
  [each.querySelector('dt').textContent, each.querySelector('dd').textContent]))"""
CURVES = (
    """() => Object.fromEntries(document.getElementById('convergence').data.map(({ name, x, y }) => [name, [x, y]]))"""
)


def test_the_page_of_a_job_that_ended_within_a_second_agrees_with_its_result(page, home, cluster):
    with cluster.connect() as client:
        job = client.submit(ROOT / "examples" / "arm-ik.toml", generations=30, target=-1.0)
        result = job.result(60)
        told = client.records("history", job.id)
    assert result.seconds < 1
    page.goto(home + f"jobs/{job.id}")
    see(page, "#facts div:has(dt:text-is('best alive')) dd:not(:text-is('–'))")
    see(page, "#convergence .main-svg .scatterlayer .trace")
    facts = {name: text.replace(",", "") for name, text in page.evaluate(FACTS).items()}
    assert (facts["seed"], facts["status"]) == ("1", "exhausted")
    assert (int(facts["generations"]), int(facts["evaluations"])) == (result.generations, result.evaluations)
    alive = [float(facts[f"{name} alive"]) for name in ("best", "median", "worst")]
    assert alive == sorted(alive)
    assert float(facts["fitness"]) == pytest.approx(result.fitness, rel=1e-3)
    assert alive[0] >= float(facts["fitness"])
    _, heard = page.evaluate(CURVES)["verified"]
    assert heard[-1] == result.fitness
    page.select_option("#against", "generation")
    until(lambda: "best so far" in page.evaluate(CURVES))
    noted = [dict(zip(told["columns"], row, strict=True)) for row in told["rows"]]
    curve = [[each["generation"] for each in noted], [each["fitness"] for each in noted]]
    assert page.evaluate(CURVES)["best so far"] == curve
    assert curve[1][-1] == result.fitness < curve[1][0], "no flat curve"
    rows = page.evaluate("[...document.querySelectorAll('#rows tr')].map((row) => row.children[1].textContent)")
    assert [int(text) for text in rows] == curve[0]


def test_an_improvement_is_on_the_page_before_the_store_has_it(service, show, page_of, file):
    service.submitted(wire.Submit(supernode.load(file).to_json(), "mine", 0))
    service.tell("mine", "running")
    home = f"http://127.0.0.1:{show().port}/"
    page = page_of(home)
    page.goto(home + "jobs/mine")
    page.wait_for_selector("#facts >> text=running")
    better = Improvement(1, 0, 0.1, 3, 2, 0.25, True, {"x": [0.5, 0.0], "value": 0.25})
    service.publish(service.keys.best, better.encode())  # the coordinator's best remains none
    see(page, "#facts div:has(dt:text-is('fitness')) dd:text-is('0.25')")
    assert json.loads(page.text_content("#solution")) == better.solution
    until(lambda: page.evaluate(CURVES)["verified"][1][-1] == 0.25)


def test_the_page_of_the_cluster_shows_how_jobs_are_spread_over_hosts(service, show, page_of):
    spread = {"job": "mine", "hosts": {"rack1/a": 24, "rack1/b": 40}, "crossing": 32, "edges": 256}
    service.placements.append(spread)
    home = f"http://127.0.0.1:{show().port}/"
    page = page_of(home)
    page.goto(home)
    see(page, "#facts div:has(dt:text-is('cells of mine by host'))")
    see(page, "#facts dd:text-is('rack1/a 24, rack1/b 40; 13 % of edges cross')")


def test_a_dead_cell_is_seen_on_the_page_of_its_job(page, home, cluster, endless):
    page.goto(home + f"jobs/{endless.id}")
    page.wait_for_selector("#legend >> text=lower is better")
    with cluster.connect() as client:
        cell = client.job(endless.id).show()["nodes"].index(6)
    see(page, f"[data-cell='{cell}'][data-state=alive][fill^=rgb]")
    os.kill(cluster.processes()["node 6"], signal.SIGKILL)
    see(page, f"[data-cell='{cell}'][data-state=dead]", 5)
    see(page, f"[data-cell='{cell}'][data-state=alive][fill^=rgb]")


def test_what_is_in_space_can_be_turned(page, home, cluster):
    page.goto(home + f"jobs/{solved_in_space(cluster)}")
    see(page, "#spaces canvas")
    until(lambda: page.is_hidden("#scene"))
    assert "in space" in page.get_attribute(".space", "aria-label")
    eye = "document.querySelector('.space').layout.scene.camera.eye.x"
    before = page.evaluate(eye)
    page.focus(".space")
    page.keyboard.press("ArrowLeft")
    until(lambda: page.evaluate(eye) != before)


def test_where_nothing_can_be_turned_there_is_a_picture(page, home, cluster):
    page.add_init_script(
        "const before = HTMLCanvasElement.prototype.getContext;"
        "HTMLCanvasElement.prototype.getContext = function (kind, ...more) {"
        "  return kind.startsWith('webgl') ? null : before.call(this, kind, ...more); };"
    )
    page.goto(home + f"jobs/{solved_in_space(cluster)}")
    until(lambda: page.evaluate("document.getElementById('scene').naturalWidth") > 0)
    page.wait_for_selector("#scene[alt^='The best solution of job']")
    assert page.query_selector("#spaces canvas") is None


def solved_in_space(cluster):
    with cluster.connect() as client:
        job = client.submit(ROOT / "examples" / "sphere-path.toml", seconds=20)
        job.answer(60)
        return job.id


def test_the_form_says_what_is_wrong(chromium, home):
    page = chromium.new_page()
    page.goto(home + "jobs")
    page.select_option("#kind", "arm-ik")
    until(lambda: "arm-ik" in page.input_value("textarea"))
    page.fill("textarea[name=file]", "kind = <b>")
    with page.expect_response("**/api/jobs") as refused:
        page.click("form#submit button")
    assert refused.value.status == 400
    page.wait_for_selector("#trouble >> text=expected TOML")
    page.close()


def test_a_double_click_is_one_job(page, home, cluster):
    page.goto(home + "jobs")
    page.fill("textarea[name=file]", (ROOT / "examples" / "arm-ik.toml").read_text())
    page.fill("input[name=seconds]", "1")
    with cluster.connect() as client:
        before = len(client.jobs())
        page.evaluate("for (const _ of [1, 2]) document.querySelector('form#submit button').click()")
        page.wait_for_url("**/jobs/*")
        page.wait_for_selector("#facts >> text=arm-ik")
        assert len(client.jobs()) == before + 1


def test_one_wrong_id_leaves_the_other_runs(chromium, home, endless):
    page = chromium.new_page()  # the browser itself complains of an answer that refuses
    page.goto(home + f"compare?jobs=nobody,{endless.id}")
    page.wait_for_selector("#trouble >> text=nobody: ")
    page.wait_for_selector(f"#table >> text={endless.id}")
    page.wait_for_selector("#seconds .main-svg .scatterlayer .trace")
    page.goto(home + f"compare?jobs={','.join([endless.id] * 9)}")
    page.wait_for_selector("#trouble >> text=Only the first 8 of 9 jobs")
    page.close()


def test_a_hidden_page_holds_no_stream_and_comes_back(page, home):
    streams = []
    page.on("request", lambda request: streams.append(request) if request.url.endswith("/events") else None)
    page.goto(home)
    page.wait_for_selector("#link[data-state=answers]")
    turn = (
        "(hidden) => { Object.defineProperty(document, 'hidden', { value: hidden, configurable: true });"
        " document.dispatchEvent(new Event('visibilitychange')); }"
    )
    with page.expect_event("requestfailed", lambda request: request.url.endswith("/events")):
        page.evaluate(turn, True)
    with page.expect_request("**/events"):
        page.evaluate(turn, False)
    assert len(streams) == 2


def test_a_stream_that_is_refused_is_asked_for_again(chromium, home):
    page = chromium.new_page()  # the browser itself complains of an answer that refuses
    page.route("**/events", lambda route: route.fulfill(status=503, body="there are 100 streams already"), times=1)
    page.goto(home)
    page.wait_for_selector("#link >> text=dashboard away")
    page.wait_for_selector("#link[data-state=answers]")
    page.close()


def test_long_curves_are_thinned_and_break_between_epochs(page, home):
    page.goto(home + "jobs")
    lengths, first, last, gaps = page.evaluate("""async () => {
      const { History, generation, line } = await import("/static/history.js");
      const history = new History("any"), columns = ["id", "epoch", "generation", "fitness"];
      const row = (id) => [id, id < 5000 ? 0 : 1, id, 100000 - id];
      window.fetch = async (address) => {
        const after = Number(new URL(address, location).searchParams.get("improvements"));
        const rows = Array.from({ length: 1000 }, (_, index) => row(after + index + 1));
        const none = { columns, rows: [], more: false };
        return Response.json({ improvements: { columns, rows, more: after < 9000 }, statistics: none });
      };
      await history.load();
      const { improvements, latest } = history, curve = line("any", improvements, generation, "fitness");
      const steps = new Set(improvements.slice(1, -1).map((each, index) => each.id - improvements[index].id));
      return [[improvements.length, latest.length, steps.size], improvements[0].id, improvements.at(-1).id,
        curve.y.filter((each) => each === null).length];
    }""")
    assert 1000 <= lengths[0] <= 2000
    assert lengths[1:] == [200, 1], "evenly, and the latest all"
    assert (first, last, gaps) == (1, 10000, 1)


def test_jobs_are_cancelled_by_button(page, home, endless):
    page.goto(home + "jobs")
    page.click(f"button[aria-label='cancel {endless.id}']")
    page.wait_for_selector(f"tr:has(a[href='/jobs/{endless.id}']) td[data-state=cancelled]")


def test_a_dashboard_that_died_is_replaced_at_the_same_address(cluster, home):
    victim = until(lambda: dashboard_of(cluster))
    os.kill(victim, signal.SIGKILL)
    until(lambda: dashboard_of(cluster) not in (victim, None))
    until(lambda: answers(home))


@pytest.mark.parametrize("kind", [signal.SIGTERM, signal.SIGKILL])
def test_it_ends_with_the_cluster(tmp_path, kind):
    with live(tmp_path, "torus 1x2", "--dashboard", "127.0.0.1:0") as service:
        until(lambda: answers(address_in(service.line)))
        watched = os.pidfd_open(dashboard_of(service))
        os.kill(service.process.pid, kind)
        try:
            until(lambda: has_ended(watched), 10)
        finally:
            os.close(watched)


def has_ended(descriptor):
    return select.select([descriptor], [], [], 0)[0] != []


def test_an_onlooker_shows_a_running_cluster(cluster):
    command = [sys.executable, "-m", "supernode", "spy", "--connect", cluster.info().endpoint]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with subprocess.Popen(
        [*command, "--dashboard", "127.0.0.1:0"], stdout=subprocess.PIPE, env=environment, text=True
    ) as process:
        try:
            address = address_in(process.stdout.readline())
            until(lambda: answers(address))
            process.send_signal(signal.SIGINT)
            assert process.wait(10) == 130
        finally:
            process.kill()


def test_a_single_run_is_shown_as_long_as_it_lasts(page_of, tmp_path):
    path = tmp_path / "<b>endless.toml"
    path.write_text(ENDLESS)
    log = tmp_path / "run.jsonl"
    command = [sys.executable, "-m", "supernode", "solve", str(path), "--dashboard", "127.0.0.1:0", "--json"]
    command += ["--log", str(log)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, env=os.environ | {"PYTHONPATH": str(ROOT)}, **pipes) as process:
        try:
            home = address_in(next(line for line in process.stderr if "dashboard " in line))
            page = page_of(home)
            page.goto(home + "jobs")
            page.wait_for_selector("main >> text=It takes no other jobs")
            assert page.query_selector("form#submit") is None
            page.click("#rows a")
            page.wait_for_selector("text=A single run")
            page.wait_for_selector("#facts >> text=running")
            see(page, "#convergence .main-svg .scatterlayer .trace")
            form = urllib.parse.urlencode({"file": ENDLESS}).encode()
            with pytest.raises(urllib.error.HTTPError) as refused:
                urllib.request.urlopen(home + "api/jobs", form)
            assert "the queue is full" in refused.value.read().decode()
            page.close()
            until(lambda: '"statistics"' in log.read_text())
            process.send_signal(signal.SIGINT)
            out, _ = process.communicate(timeout=30)
            assert process.returncode == 130
            assert json.loads(out)["status"] == "cancelled"
            assert not answers(home)
        finally:
            process.kill()
    first, *others, last = [json.loads(line) for line in log.read_text().splitlines()]
    assert (first["event"], last["event"], last["status"]) == ("start", "end", "cancelled")
    assert any(each["event"] == "improvement" for each in others)
    generations = [each["generation"] for each in others if each["event"] == "statistics"]
    assert generations == sorted(generations)


def test_its_metrics_count_what_the_nodes_do(cluster, home, endless):
    def text():
        with urllib.request.urlopen(home + "metrics") as answer:
            return answer.read().decode()

    for name in ("generations_total", "evaluations_total", "messages_received_total", "exchange_seconds", "job_epoch"):
        until(lambda line=f'supernode_{name}{{job="{endless.id}"}} ': line in text())
    assert "supernode_nodes_alive 16.0" in text()
