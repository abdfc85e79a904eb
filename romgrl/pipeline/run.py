"""Run one configuration: which stages there are to make, in which order, and which of them side by side."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, ThreadPoolExecutor, wait
from dataclasses import asdict, replace
from pathlib import Path
from queue import SimpleQueue

from rich.console import Console

from romgrl.cli.consistency import validate
from romgrl.config.commanded import is_conditioned
from romgrl.config.schema import Config
from romgrl.pipeline.job import Job
from romgrl.pipeline.run_names import job_note, job_title
from romgrl.pipeline.watch import watch
from romgrl.pipeline.worker import Worker, execute
from romgrl.provenance.shipped import require_shipped
from romgrl.provenance.stage_graph import STAGES, plan, share_threads, wanted
from romgrl.provenance.stage_keys import body_digests
from romgrl.report.terminal_tables import HEADLINE, TRAINING_MINUTES, headline
from romgrl.runtime import signals
from romgrl.runtime.cores import available_cores
from romgrl.runtime.stage_log import WIDEST_TABLE, make_bars, make_console
from romgrl.tracking.journal import redacted
from romgrl.tracking.recorder import SYSTEM_METRICS, bring_journals, jobs_address, open_recorder, ui_command

WORKERS = 2  # the graph has no three stages that do not need each other
LOOK_SECONDS = 0.1  # between two looks at whether a signal has come


def run(
    config: Config,
    *,
    name: str = "job",
    overrides: Sequence[str] = (),
    parent: str | None = None,
    place: tuple[int, int] | None = None,
    console: Console | None = None,
) -> dict[str, Path]:
    """Run `config.stage` and what it needs, print where everything is, and return the artifact of each stage used.

    `overrides` are those of its command line, `parent` is the MLflow run of the sweep, `place` which of its jobs this
    is, and of how many. Raises ConfigurationError, or ArtifactError for damaged
    files of the package, before anything is made.
    """
    validate(config)
    require_shipped(config)
    config = resolve(config)
    body_digests.cache_clear()  # the file may have changed since the last job
    if config.stage == "sync":
        return bring_the_rest(config, name, console or make_console())
    if config.stage == "verify":
        return show_verdicts(config, overrides, console or make_console())
    if config.stage == "watch":
        return watch(config, console or make_console())
    signals.listen()
    outputs = Path(config.paths.outputs)
    tracking = config.tracking
    recorder = open_recorder(tracking.uri, tracking.experiment, outputs, enabled=tracking.enabled)
    title = redacted(job_title(name, config, overrides))
    tags = {"stage": "job"} | ({SYSTEM_METRICS: "true"} if tracking.system_metrics else {})
    tracked = recorder.start(title, parent=parent, tags=tags, params=asdict(config))
    console = console or make_console()
    job = Job(config, recorder, tracked, make_bars(console), overrides)
    if parent is not None or place is not None:
        job.say(f"job{' {} of {}'.format(*place) if place else ''}: {redacted(' '.join(overrides) or name)}")
    if place is not None:
        job.bars.add_task("sweep", total=place[1], completed=place[0] - 1, speed="", numbers=f"job {place[0]}")
    status = "FAILED"
    try:
        with job.bars:
            run_stages(job)
        describe_run(job, title)  # first: the UI shows the numbers of a run in the order in which they came
        job.record_reuse()
        tracked.metrics(job.numbers(), 0)
        status = "FINISHED"
    except KeyboardInterrupt:
        status = "KILLED"
        raise
    finally:
        tracked.finish(status)
        recorder.close()
    for stage, directory in job.finished.items() if place is None else ():  # a sweep ends with one table of all jobs
        for each in STAGES[stage].shown(directory, asked=stage == config.stage):
            job.say(each) if isinstance(each, str) else console.print(each)
    if "report" in job.finished:
        job.say(f"report: {job.finished['report'] / 'report.html'}, figures and films beside it")
    if recorder.journal is not None:
        job.say(f"compare runs: {ui_command(recorder.uri)}")
        if recorder.experiment_id is not None:
            job.say(f"jobs, best first: {jobs_address(recorder.uri, recorder.experiment_id, next(iter(HEADLINE)))}")
    return job.finished


def describe_run(job: Job, title: str) -> None:
    """Give the job's run its description and the numbers that the UI shows first."""
    numbers = headline(job.numbers())
    if {"teacher", "student", "baseline"} <= job.manifests.keys():
        numbers |= {TRAINING_MINUTES: sum(each.wall_time for each in job.manifests.values()) / 60}
    job.run.metrics(numbers, 0)
    job.run.describe(job_note(title, job.manifests, job.reused, numbers))


def bring_the_rest(config: Config, name: str, console: Console) -> dict[str, Path]:
    """Send MLflow what earlier jobs could not, and print what that was; to another experiment if `name` gives one."""
    experiment = config.tracking.experiment if "tracking.experiment=" in name else None
    for line in bring_journals(config.tracking.uri, Path(config.paths.outputs), experiment):
        console.print(line, markup=False, highlight=False, soft_wrap=True)
    return {}


def show_verdicts(config: Config, overrides: Sequence[str], console: Console) -> dict[str, Path]:
    """Print what finished evaluations of a configuration say about the paper's claims."""
    from romgrl.results.verify import verify  # takes a second to import

    console.width = max(console.width, WIDEST_TABLE)
    for each in verify(config, [redacted(text) for text in overrides]):
        if isinstance(each, str):
            console.print(each, markup=False, highlight=False, soft_wrap=True)
        else:
            console.print(each.rich())
    return {}


def resolve(config: Config) -> Config:
    """Make the output directory the one that a link leads to, and the number of threads explicit."""
    outputs = Path(config.paths.outputs).resolve()
    return replace(
        config, threads=config.threads or available_cores(), paths=replace(config.paths, outputs=str(outputs))
    )


def run_stages(job: Job) -> None:
    """Make what is missing: in this process one after the other, or in two where stages can run side by side."""
    config = job.config
    follows = is_conditioned(config)
    stages = plan(wanted(config.stage, conditioned=follows), job.present, conditioned=follows)
    job.require_places(stages)
    threads = dict.fromkeys(stages, config.threads)
    if config.parallel_stages and config.threads >= WORKERS:
        missing = [stage for stage in stages if not job.present(stage)]
        threads |= share_threads(missing, config.threads, conditioned=follows)
    if all(share == config.threads for share in threads.values()):
        for stage in stages:
            job.ensure(stage, runner=execute, threads=config.threads)
    else:
        run_side_by_side(job, stages, threads)


def run_side_by_side(job: Job, stages: Sequence[str], threads: Mapping[str, int]) -> None:
    """Make each stage as soon as what it needs is finished; the first that fails stops the others."""
    workers = [Worker() for _ in range(WORKERS)]
    idle: SimpleQueue[Worker] = SimpleQueue()
    for worker in workers:
        idle.put(worker)

    def ensure(stage: str, upstream: Sequence[Future[None]]) -> None:
        for future in upstream:
            future.result()
        worker = idle.get()
        try:
            if job.stopping.is_set():
                raise KeyboardInterrupt
            job.ensure(stage, runner=worker.run, threads=threads[stage])
        finally:
            idle.put(worker)

    with signals.counted(), ThreadPoolExecutor(len(stages)) as pool:
        futures: dict[str, Future[None]] = {}
        try:
            for stage in stages:
                upstream = [futures[name] for name in job.reads(stage) if name in futures]
                futures[stage] = pool.submit(ensure, stage, upstream)
            wait_for_first(futures.values())
        finally:
            end(job, workers, futures.values())
    signals.raise_pending()
    raise_first([future.exception() for future in futures.values()])


def wait_for_first(futures: Collection[Future[None]]) -> None:
    """Wait until all are done, one has failed, or a signal has come."""
    while signals.count() == 0:
        done, left = wait(futures, LOOK_SECONDS, return_when=FIRST_EXCEPTION)
        if not left or any(future.exception() for future in done):
            return


def end(job: Job, workers: Collection[Worker], futures: Collection[Future[None]]) -> None:
    """Let the workers go. A stage that still runs is interrupted and saves itself; one more signal does not wait."""
    heard = signals.count()
    if not all(future.done() for future in futures):
        job.stopping.set()
        for worker in workers:
            worker.stop()
        while wait(futures, LOOK_SECONDS).not_done:
            if signals.count() > heard:
                for worker in workers:
                    worker.kill()
    for worker in workers:
        worker.close()


def raise_first(errors: Sequence[BaseException | None]) -> None:
    """Raise the failure of a stage; stages that were interrupted because of it come second."""
    ended = [error for error in errors if error is not None]
    for error in sorted(ended, key=lambda error: isinstance(error, KeyboardInterrupt)):
        raise error
