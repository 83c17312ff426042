"""Means of dwells: the scatter of single readings weighs them, and their noise shows in the residuals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import read_machine, read_survey
from identification import fit, import_survey
from tests.helpers.importing import MILL, TRUTH, logs
from tests.helpers.lengths import standardised


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("means")
    logs(out, rows=45)
    import_survey(out / "tracker.csv", MILL, commands=out / "controller.csv").save(out / "s")
    return out


@pytest.mark.long
def test_uncertainties_are_those_of_means(folder: Path) -> None:
    """Readings scatter by 3 um, means of 25 and more of them by 0.5 to 0.6: five times less."""
    survey = read_survey(folder / "s", read_machine(MILL))
    assert survey.scatter
    assert survey.table["sigma_x"].median() == pytest.approx(0.003, rel=0.2)
    result = fit(MILL, survey)
    assert result.fit.sigma_mm == pytest.approx(0.00057, rel=0.2)
    assert "from residuals" in result.summary()
    errors = {n: z for n, z in standardised(result.fit, TRUTH).items() if not n.startswith("frame")}
    assert 0.6 < np.sqrt(np.mean(np.square([*errors.values()]))) < 1.5  # 0.2 with the scatter of single readings


@pytest.mark.long
def test_what_a_file_declares_is_no_scatter(folder: Path) -> None:
    text = (folder / "tracker.csv").read_text().splitlines()
    declared = pd.DataFrame([line.split(",") for line in text[1:]], columns=text[0].split(",")).assign(sigma="0.003")
    declared.to_csv(folder / "declared.csv", index=False)
    result = import_survey(folder / "declared.csv", MILL, commands=folder / "controller.csv")
    assert not result.survey.scatter
    assert "follow the declared one" in fit(MILL, result.survey).summary()
