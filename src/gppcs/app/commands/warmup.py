"""The command `gppcs warmup`: compiles all kernels."""

from gppcs import __version__
from gppcs.app import options
from gppcs.app.printing import emit, say, started
from gppcs.errors import OutputError

EPILOG = "gppcs warmup"


def warmup(threads: options.Threads = None, quiet: options.Quiet = False, as_json: options.Json = False) -> None:
    """Compile all kernels now, in a minute or two. Later runs then start at once.

    Compiled kernels are stored in the first of these folders that can be written: the one that NUMBA_CACHE_DIR names,
    that of the installed package, the user's cache folder. Run this again after an update of gppcs or Numba, or on
    another kind of processor.
    """
    from gppcs.app.compilation import parts
    from gppcs.engine.helpers import run_all
    from gppcs.engine.kernel_cache import folder_to_write

    folder, compiled = folder_to_write(), 0
    if not folder:
        raise OutputError("expected a folder for kernels that can be written, found none; set NUMBA_CACHE_DIR to one")
    timer, work = started(quiet, threads), parts()
    with timer("compiling kernels", len(work)) as on_progress:
        for count in run_all(work):
            compiled += count
            on_progress(1)
    seconds = sum(timer.seconds.values())
    if as_json:
        emit({"compiled": compiled, "seconds": seconds, "folder": str(folder), "version": __version__}, as_json)
    elif not quiet:
        say(f"kernels compiled: {compiled}, in {seconds:.1f} s; all are kept in {folder}")
