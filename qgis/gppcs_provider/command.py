"""Runs the command gppcs. It has a Python of its own: that of QGIS may have a NumPy that is too old."""

import os
import re
import shutil
import subprocess

from processing.core.ProcessingConfig import ProcessingConfig
from qgis.core import QgsProcessingException
from qgis.PyQt.QtCore import Qt

NAME, SETTING = "gppcs", "GPPCS_COMMAND"
HELP = (
    "Install gppcs in a Python of version 3.11 or later, and name the file of its command in Settings, Options, "
    "Processing, Providers, gppcs."
)


def run(arguments, feedback):
    """Run gppcs, show its progress and messages, and return what it prints."""
    command = ProcessingConfig.getSetting(SETTING) or shutil.which(NAME)
    if not command:
        raise QgsProcessingException(f"The command gppcs was not found. {HELP}")
    feedback.pushCommandInfo(subprocess.list2cmdline([command, *arguments]))
    # QGIS may have set these for its own Python.
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONHOME", "PYTHONPATH")}
    try:
        process = subprocess.Popen(
            [command, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
            env={**environment, "PYTHONUTF8": "1", "GPPCS_PROGRESS": "lines"},
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),  # on Windows, no black window
        )
    except OSError as error:
        raise QgsProcessingException(f"{command} cannot be run ({error.strerror}). {HELP}") from error
    # Who cancels does so in another thread, and this one waits for the next line.
    feedback.canceled.connect(process.terminate, Qt.ConnectionType.DirectConnection)
    if feedback.isCanceled():
        process.terminate()
    last = ""
    for line in process.stderr:
        last = line.rstrip()
        _show(last, feedback)
    printed, _ = process.communicate()
    if process.returncode:
        raise QgsProcessingException("Canceled." if feedback.isCanceled() else last)
    return printed


def _show(line, feedback):
    """Show a line of gppcs as progress or as a message."""
    progress = re.fullmatch(r"progress: (.*?)(?: (\d+) %)?", line)
    if progress:
        stage, percent = progress.groups()
        feedback.setProgress(int(percent or 0))
        if percent is None:
            feedback.setProgressText(stage)
    elif line.startswith("gppcs: note:"):
        feedback.pushWarning(line)
    else:
        feedback.pushInfo(line)
