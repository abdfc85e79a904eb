"""Command line: python -m romgrl [key=value ...], or romgrl after installation."""

import signal


def main() -> None:
    """Run. Until all is imported, which takes a moment, Ctrl-C ends the process without a word."""
    answer = signal.signal(signal.SIGINT, signal.SIG_DFL)
    from romgrl.command import run

    signal.signal(signal.SIGINT, answer)
    run()


if __name__ == "__main__":
    main()
