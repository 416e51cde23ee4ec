"""The curve of a training: a line a save in `curve.csv`, drawn in `curve.png`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from pcdbench.runner.store import write_text


class Curve:
    """Step, seconds, the loss's terms and the validation error, over all resumptions of a training."""

    def __init__(self, folder: Path) -> None:
        self._csv, self._png = folder / "curve.csv", folder / "curve.png"

    def table(self) -> pd.DataFrame:
        """The curve so far; empty where there is none yet."""
        return pd.read_csv(self._csv) if self._csv.exists() else pd.DataFrame({"step": []})

    def cut(self, step: int) -> None:
        """Forget what came after the checkpoint that training goes on from."""
        table = self.table()
        write_text(self._csv, table[table["step"] <= step].to_csv(index=False))

    def add(self, step: int, seconds: float, terms: Mapping[str, float], validation: float | None) -> None:
        """Write one more line, in place of any of this step or later."""
        line = {"step": step, "seconds": round(seconds), **terms, "validation_chd": validation}
        table = self.table()
        # One that was written before its checkpoint was, and that was stopped, is written again.
        table = pd.concat([table[table["step"] < step], pd.DataFrame([line])], ignore_index=True)
        write_text(self._csv, table.to_csv(index=False))

    def draw(self) -> None:
        """Draw the curve so far into `curve.png`."""
        from matplotlib.figure import Figure

        table = self.table()
        figure = Figure(figsize=(9, 3.5), layout="constrained")
        left, right = figure.subplots(1, 2)
        for name in table.columns.difference(["step", "seconds", "validation_chd"], sort=False):
            left.plot(table["step"], table[name], label=name)
        left.set(xlabel="step", ylabel="loss and its terms", yscale="log" if (table["loss"] > 0).all() else "linear")
        left.legend(frameon=False)
        right.plot(table["step"], table["validation_chd"], drawstyle="steps-post")
        right.axhline(1.0, color="gray", linewidth=0.8)
        right.set(xlabel="step", ylabel="ChD on val, share of doing nothing", ylim=(0, None))
        figure.savefig(self._png, dpi=120)
