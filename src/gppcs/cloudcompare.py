"""gppcs in CloudCompare: a plugin of its Python runtime, which finds it once gppcs is installed there.

It is written to the documented interface of CloudCompare-PythonRuntime. Only CloudCompare can import this module.
"""

from typing import Any

import cccorelib  # type: ignore[import-not-found]
import pycc  # type: ignore[import-not-found]

import gppcs
from gppcs.amounts.options import method_of
from gppcs.methods import DEFAULT, METHODS

TITLE = "gppcs"
AMOUNT, METHOD, WEIGHT = "Points, or share such as 5%", "Method", "Feature weight of gp, 0 to 1"


class Plugin(pycc.PythonPluginInterface):  # type: ignore[misc]
    """The plugin: one action, which simplifies the selected clouds."""

    def getActions(self) -> list[Any]:  # noqa: N802  # CloudCompare's name
        """Return what the menu offers."""
        return [pycc.Action(name="Simplify", target=simplify_selected)]


def simplify_selected() -> None:
    """Ask what is wanted, and put simplified copies of the selected clouds beside them."""
    program = pycc.GetInstance()
    clouds = [entity for entity in program.getSelectedEntities() if isinstance(entity, pycc.ccPointCloud)]
    if not clouds:
        _show("Select one or more point clouds first.")
        return
    answers = _ask({AMOUNT: "5%", METHOD: DEFAULT.name, WEIGHT: "0.5"})
    if answers is None:
        return
    for cloud in clouds:
        made = pycc.RunInThread(_outcome, cloud, answers[AMOUNT], answers[METHOD], answers[WEIGHT])
        if isinstance(made, Exception):
            _show(f"{cloud.getName()}: {made}")
        else:
            program.addToDB(made)
    program.updateUI()


def _outcome(*arguments: Any) -> Any:
    """Return what `simplified` does, or its error, of which `RunInThread` would lose the text."""
    try:
        return simplified(*arguments)
    except Exception as error:
        return error


def simplified(cloud: Any, amount: str, method: str, feature_weight: str) -> Any:
    """Return a copy of a cloud, and of all it carries, with an amount of points such as "1.5M", "5%" or "0.05"."""
    is_ratio = "%" in amount or amount.startswith(("0", "."))
    ratio, n_points = (amount, None) if is_ratio else (None, amount)
    settings = {"feature_weight": feature_weight} if method == "gp" else {}
    chosen = method_of(method, settings=settings)
    result = gppcs.simplify(cloud.points(), ratio=ratio, n_points=n_points, method=chosen)
    kept = cccorelib.ReferenceCloud(cloud)
    for row in result.indices.tolist():
        kept.addPointIndex(row)
    copy = cloud.partialClone(kept)
    if copy is None:
        raise MemoryError("CloudCompare could not make the copy; there may not be enough memory")
    copy.setName(f"{cloud.getName()} ({len(result.indices):,} points, {result.method})")
    return copy


def _ask(defaults: dict[str, str]) -> dict[str, str] | None:
    """Show a dialog with a field for each default; return what is entered, or nothing if it is closed."""
    import tkinter
    from tkinter import ttk

    window, entered = tkinter.Tk(), dict[str, str]()
    window.title(TITLE)
    fields = {}
    for row, (label, default) in enumerate(defaults.items()):
        ttk.Label(window, text=label).grid(row=row, column=0, sticky="w", padx=6, pady=3)
        fields[label] = tkinter.StringVar(window, default)
        field = ttk.Combobox(window, values=list(METHODS)) if label == METHOD else ttk.Entry(window)
        field.configure(textvariable=fields[label])
        field.grid(row=row, column=1, padx=6, pady=3)

    def done() -> None:
        entered.update({label: field.get().strip() for label, field in fields.items()})
        window.destroy()

    ttk.Button(window, text="Simplify", command=done).grid(row=len(defaults), column=1, sticky="e", padx=6, pady=6)
    window.mainloop()
    return entered or None


def _show(text: str) -> None:
    """Show a message."""
    import tkinter
    from tkinter import messagebox

    window = tkinter.Tk()
    window.withdraw()
    messagebox.showinfo(TITLE, text, parent=window)
    window.destroy()
