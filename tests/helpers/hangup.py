"""A plugin that is imported before conftest.py: below nohup, tests would inherit that SIGHUP is ignored.

The jobs that they start, too; and romgrl.runtime.signals, which conftest.py imports, looks at it once.
"""

import signal

signal.signal(signal.SIGHUP, signal.SIG_DFL)
