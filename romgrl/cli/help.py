"""What `python -m romgrl --help` prints."""

from __future__ import annotations

from pathlib import Path

from romgrl.provenance.stage_graph import ACTIONS, STAGES

HELP = """romgrl: a humanoid learns to walk and run from a reduced-order model, with no human demonstration.

  python -m romgrl                               the whole pipeline (about 8 minutes)
  python -m romgrl stage=teacher                 one stage, with what it needs
  python -m romgrl -m speed=1,4 eta=0.3,0.5      a sweep; what jobs share is trained once
  python -m romgrl student=pretrained            walkers that ship, scored and drawn (about a minute)
  python -m romgrl experiment=paper              the paper, taken literally (hours)
  python -m romgrl --config-dir sweeps --config-name paper    a stored sweep (of the source)

Keys:
  stage      all, or one of these, with what it needs:
{stages}
  speed      target speed of student and baseline in m/s
  eta        weight of the task reward; 1 - eta weighs imitation
  noise      standard deviation of the noise on the discriminator's features
  seed, device (cpu, cuda), threads (0: all cores), paths.outputs (where results go)

Groups as group=choice, and every key in them as group.key=value:
{groups}

Options: -m sweeps over lists; --cfg job prints all keys and values; --version; --hydra-help Hydra's own options.
docs/configuration.md of the source explains every key with its unit, range and default.
Exit codes: 0 done, 1 a job of a sweep was lost, 2 bad configuration, 3 bad or missing artifact, 4 diverged,
5 disk full, read-only or broken, 130, 143, 140 and 129 interrupted by SIGINT, SIGTERM, SIGUSR2 and SIGHUP."""


def usage(conf: Path) -> str:
    """The text, with all stages, and the choices of every group in a configuration directory."""
    groups = sorted(path for path in conf.iterdir() if path.is_dir() and path.name != "hydra")
    lines = [f"  {group.name:<14} {', '.join(sorted(file.stem for file in group.glob('*.yaml')))}" for group in groups]
    docs = {name: stage.doc + ("; no part of all" if stage.optional else "") for name, stage in STAGES.items()}
    stages = [f"             {name:<11} {doc}" for name, doc in (docs | ACTIONS).items()]
    return HELP.format(stages="\n".join(stages), groups="\n".join(lines))
