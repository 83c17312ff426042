"""The rules that decide in a diagnosis, by name: what each decides, on which scale, by which constants.

The names are in the decision log, and stay the same from version to version. A constant is named by its module below
``identification.diagnosis`` and its name there.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from identification.diagnosis.decisions.rule import CHANCE, COUNT, DELTA, ERRORS, EVIDENCE, GAIN, RATIO, SHARE, Rule
from identification.diagnosis.decisions.rule import decided as _decided
from identification.diagnosis.decisions.rule import in_module as _in
from identification.diagnosis.decisions.rules_of_data import RULES_OF_DATA
from identification.diagnosis.decisions.stages import (
    COMPARISON,
    CONDITIONAL,
    NAMES,
    NOISE,
    PROPOSALS,
    SELECTION,
    UNTESTABLE,
    VERDICT,
    WITNESSES,
)

_NOISE = "search.instrument_noise"
_SCORING, _FORWARD, _REFINED = "search.scoring", "search.forward_selection", "search.refinement"
_COMPARED, _WITNESSES, _FINDINGS = "search.model_comparison", "results.witnesses", "results.findings"

RULES: Mapping[str, Rule] = MappingProxyType(
    {
        **RULES_OF_DATA,
        # ---- instrument noise
        "points-for-noise": Rule(
            NOISE, COUNT,
            "A line of sight is looked for in so many points with three components, of an unnamed instrument.",
            _in(_NOISE, "FEWEST"),
        ),
        "residuals-are-noise": Rule(
            NOISE, COUNT, "It is looked for only once there is evidence for no further candidate.", _in(_NOISE, "MOST")
        ),
        "line-of-sight": Rule(
            NOISE, GAIN, "Residuals like those of a line of sight weigh the rows, if they turn.",
            _in(_NOISE, "CLEAR", "ORIGIN", "CLOSEST_MM"),
        ),
        "one-direction-instead": Rule(
            NOISE, GAIN, "Noise that is larger along a line of sight than across it must clearly turn with it.",
            _decided("DECISIVE_ODDS"),
        ),
        "declared-station": Rule(
            NOISE, GAIN, "A declared station that fits better as a point of the machine is named.",
            _in(_NOISE, "CLEAR") + _decided("MISFIT_RATIO"),
        ),
        "noise-of-kinds": Rule(
            NOISE, RATIO, "The search is repeated with the noise of positions, orientations and readings that it left.",
            _decided("MISFIT_RATIO"),
        ),
        # ---- candidates
        "rows-used": Rule(
            PROPOSALS, COUNT, "Candidates are scored in no more rows than this.", _in("linear.of_fit", "MOST_ROWS")
        ),
        "run-labels": Rule(
            PROPOSALS, COUNT, "A run drives candidates where there are few labels, each of enough rows.",
            _in("linear.of_fit", "MOST_RUNS", "LEAST_RUN"),
        ),
        "collinear-with-geometry": Rule(
            PROPOSALS, SHARE, "A candidate of which the geometry leaves no direction has no score.",
            _decided("ABSORBED", "FORM_ABSORBED"),
        ),
        # ---- forward selection
        "candidate-score": Rule(
            SELECTION, EVIDENCE, "The best candidates of a round are examined, and the best of each further name.",
            _decided("SIZES") + _in(_FORWARD, "LIKELY") + _in("search.shape_fit", "MAYBE", "OF_A_NAME"),
        ),
        "least-evidence": Rule(
            SELECTION, EVIDENCE, "Where no candidate has as much evidence the search ends.", _decided("LEAST_EVIDENCE")
        ),
        "optimised-score": Rule(
            SELECTION, EVIDENCE,
            "A candidate's shape is moved to where it fits best, and a discrepancy from its textbook form allowed.",
            _decided("DEPARTURES"),
        ),
        "not-settled": Rule(
            SELECTION, "K",
            "A member may have had another temperature than its sensor in the first row, where that is likelier.",
        ),
        "most-evidence": Rule(
            SELECTION, EVIDENCE, "Of named effects, that with most evidence over the number of its places is first."
        ),
        "empirical-lead": Rule(
            SELECTION, EVIDENCE, "An empirical term must lead the best named effect clearly.", _decided("CLEARLY")
        ),
        "preference": Rule(SELECTION, EVIDENCE, "The candidate that is tested for acceptance, by the rules before."),
        "refinement-first": Rule(
            SELECTION, EVIDENCE, "What may refine a finding is tried before a new one.", _decided("MUCH")
        ),
        "same-motion-and-driver": Rule(
            SELECTION, "", "What moves the same by the same driver is a refinement of that finding.",
            _decided("MUCH") + _in(_REFINED, "DISTINCT"),
        ),
        "remainder-of-surface": Rule(
            SELECTION, "", "What follows one driver of an empirical form over two refines that form."
        ),
        "left-over": Rule(
            SELECTION, DELTA, "What explains little of a finding at its place by its drivers is left over from it.",
            _decided("LITTLE"),
        ),
        "detection": Rule(
            SELECTION, EVIDENCE, "The evidence less the trials factor must be clear.", _decided("DECISIVE_ODDS")
        ),
        "detection-in-correlated-noise": Rule(
            SELECTION, EVIDENCE, "The same less what correlated noise and the discrepancy would explain as well.",
            _decided("DECISIVE_ODDS", "EVEN", "NOISE"),
        ),
        "share-of-findings": Rule(
            SELECTION, DELTA,
            "What is a small part of what is explained already may be a discrepancy of it, and is no finding.",
            _decided("LITTLE"),
        ),
        "most-steps": Rule(SELECTION, COUNT, "No more effects than this.", _in(_FORWARD, "MOST_STEPS")),
        "refinement-below-detection": Rule(
            SELECTION, EVIDENCE, "Below the level of a finding, the best refinement of one is tried.",
            _decided("LEAST_EVIDENCE"),
        ),
        "competing-refinement": Rule(
            SELECTION, EVIDENCE, "Refinements of one finding with enough evidence compete by cross-validation.",
            _decided("MUCH") + _in(_FORWARD, "MOST_COMPETING"),
        ),
        "cross-validation": Rule(
            SELECTION, ERRORS,
            "Blocks of rows, each predicted without it, must be likelier with a name, and nearer with other terms.",
        ),
        "second-sensor": Rule(
            SELECTION, EVIDENCE, "A second sensor or lag is added where it has evidence and predicts better.",
            _decided("LEAST_EVIDENCE"),
        ),
        "step-function": Rule(
            SELECTION, "log evidence (Schwarz)",
            "An empirical form becomes a step function where that explains clearly more.", _decided("CLEARLY"),
        ),
        "reselection": Rule(
            SELECTION, EVIDENCE, "A finding is named again, or left out, where the whole model has more evidence so.",
        ),
        "unmoved": Rule(
            SELECTION, SHARE, "What is fitted of a finding has hardly changed since it was last compared with others.",
            _decided("NEAR"),
        ),
        "seen-before": Rule(SELECTION, "", "A renaming that leads back to an earlier model is not made."),
        "superfluous": Rule(
            SELECTION, EVIDENCE, "A finding that is not clear beside later ones is out.", _decided("DECISIVE_ODDS")
        ),
        "superfluous-by-cross-validation": Rule(
            SELECTION, ERRORS, "It stays where blocks of rows are predicted worse without it.", _decided("NO_WORSE")
        ),
        # ---- model comparison
        "strong-alternative": Rule(
            COMPARISON, EVIDENCE, "The search is repeated from an alternative whose evidence is no further behind.",
            _decided("LEAST_EVIDENCE", "NEAR") + _in(_COMPARED, "MOST_ALTERNATIVES"),
        ),
        "most-searches": Rule(
            COMPARISON, COUNT, "Searches begin with no more steps in all, but for the first one.",
            _in(_FORWARD, "MOST_STEPS"),
        ),
        "second-cause": Rule(
            COMPARISON, EVIDENCE,
            "It is repeated with a second cause, or two, where refinements or a curve have much evidence, or by heat.",
            _decided("LITTLE", "LEAST_EVIDENCE", "MUCH"),
        ),
        "search-from": Rule(COMPARISON, "", "An effect that a repeated search begins with."),
        "whole-model": Rule(COMPARISON, "log evidence", "Of names the likelier model's is taken.", _decided("CHOSEN")),
        "model-evidence": Rule(
            COMPARISON, "log evidence",
            "Another model is kept if its evidence and prior are more (with a further finding, by what detects one), a "
            "near-tie if it rests less on empirical terms; none is in which findings hide each other.",
            _decided("CLEARLY", "DECISIVE_ODDS"),
        ),
        "model-cross-validation": Rule(COMPARISON, ERRORS, "It must predict rows no worse.", _decided("NO_WORSE")),
        "prediction-made-worse": Rule(
            COMPARISON, ERRORS, "A finding with which the machine predicts rows left out worse than plain is left out.",
            _decided("NO_WORSE"),
        ),
        "cancels-geometry": Rule(
            COMPARISON, RATIO, "A finding that cancels the geometry is left out.", _in("kept_findings", "CANCELS"),
        ),
        "opposed-parts": Rule(
            COMPARISON, RATIO, "Of a finding whose parts cancel the first stays, where the rest mends little.",
            _in("kept_findings", "OPPOSED", "LITTLE_WORSE"),
        ),
        "second-order": Rule(
            COMPARISON, EVIDENCE,
            "Beside one so large that its square shows, a finding that explains nothing in exact kinematics is none.",
            _decided("LEAST_EVIDENCE"),
        ),
        "likeliest-sensor": Rule(
            COMPARISON, ERRORS, "A finding follows the likeliest of its sensors, over all lags.", _decided("NO_WORSE")
        ),
        "one-lag-instead": Rule(
            COMPARISON, EVIDENCE, "One lag from another state comes before two sensors or lags.", _decided("CLEARLY")
        ),
        "perhaps-there": Rule(
            COMPARISON, "probability",
            "An effect with too little evidence to be found is in the uncertainty of predictions by its probability.",
            _decided("CLEARLY") + _in("results.undetected", "LEAST", "MOST"),
        ),
        # ---- evidence beside the other findings
        "conditional-evidence": Rule(
            CONDITIONAL, EVIDENCE, "A finding and its alternatives, each beside all other findings.",
            _in("search.conditional_evidence", "MOST_EXAMINED"),
        ),
        "evidence-in-correlated-noise": Rule(
            CONDITIONAL, EVIDENCE, "Their evidence is no more than in correlated noise.", _decided("EVEN", "NOISE")
        ),
        # ---- witness channels
        "witness-supports": Rule(
            WITNESSES, "standard errors", "A sensor that shows the predicted motion clearly supports the finding.",
            _decided("SEEN", "AGREES"),
        ),
        "witness-contradicts": Rule(
            WITNESSES, "share of the predicted motion", "A sensor that certainly shows less contradicts the finding.",
            _decided("MUCH"),
        ),
        "uncontradicted-alternative": Rule(
            WITNESSES, EVIDENCE, "It is replaced by an alternative with so much evidence that no witness contradicts.",
            _decided("LEAST_EVIDENCE"),
        ),
        # ---- probability of a name
        "name-probability": Rule(
            NAMES, "probability", "Evidence over the number of places, and prior odds, give the probability of a name.",
            _decided("CLEARLY", "CHOSEN", "UNKNOWN"),
        ),
        "unlikely-name": Rule(NAMES, "probability", "A name that is less likely than not is none.", _decided("EVEN")),
        "curve-of-its-axis": Rule(
            NAMES, "probability", "A motion by its own axis's position alone without another name is of higher order.",
            _decided("EVEN"),
        ),
        "name-again": Rule(
            NAMES, EVIDENCE, "A form that does not lead a name clearly at last has that name.", _decided("CLEARLY")
        ),
        "departure-of-form": Rule(
            NAMES, "share of the squared size",
            "A smooth part of a larger finding, or of what the instrument sees by one cause, departs from its form.",
            _decided("LITTLE", "MUCH", "NEAR", "ABSORBED"),
        ),
        "part-of-more": Rule(
            NAMES, "times the squared size",
            "A curve of an axis has no name beside a finding without one, by that axis and another, that is not small.",
            _decided("MUCH", "ABSORBED"),
        ),
        "part-of-itself": Rule(
            NAMES, "share of the squared size", "A name that does less than what refines its form is none.",
            _decided("EVEN", "ABSORBED"),
        ),
        "nameless-alternative": Rule(
            NAMES, EVIDENCE, "A finding has a name only if no function without one explains it better.",
            _decided("NAME_ODDS", "DEPARTURES", "CLEARLY"),
        ),
        "remainder-of-name": Rule(
            NAMES, RATIO, "An effect has no name if as much is clearly left that a function without one explains.",
            _decided("MUCH", "DECISIVE_ODDS"),
        ),
        "physical-bound": Rule(
            NAMES, "standard uncertainties", "A parameter beyond what physics allows takes the name from a finding.",
            _in("results.physical_limits", "CONTRADICTED_SIGMA"),
        ),
        "physical-size": Rule(
            NAMES, "times the usual size", "So does one that is far larger than the widest of the prior distributions.",
            _decided("SIZES") + _in("results.physical_limits", "LARGEST") + _in("kept_findings", "LARGEST"),
        ),
        "distinguishable": Rule(
            NAMES, "decimal logarithm of the Bayes factor",
            "Beyond it the data distinguish an alternative from the finding.", _decided("DECISIVE_ODDS"),
        ),
        "unresolved-name": Rule(
            NAMES, "probability", "A name is no surer than this beside one that repeats between positions.",
            _decided("EVEN"),
        ),
        # ---- untestable effects
        "not-recorded": Rule(
            UNTESTABLE, "", "An effect is no candidate where the survey lacks a channel or a movement that it needs."
        ),
        "sensor-not-tried": Rule(
            UNTESTABLE, "", "A sensor that cannot be used drives no candidate, also where other sensors do."
        ),
        "hidden-by-geometry": Rule(
            UNTESTABLE, SHARE, "An effect that is collinear with the geometry cannot be seen.", _decided("ABSORBED")
        ),
        "below-noise": Rule(
            UNTESTABLE, "expected delta chi-squared",
            "An effect of which the geometry leaves, at its usual size, less than the noise cannot be seen.",
            _decided("NEAR", "DECISIVE_ODDS"),
        ),
        "not-in-readings": Rule(
            UNTESTABLE, "", "Lengths and angles that do not depend on what an effect moves cannot show it."
        ),
        "unresolved-positions": Rule(
            UNTESTABLE, "", "An effect that repeats between the positions measured looks like another one."),
        # ---- verdict
        "fit-worse-than-nominal": Rule(
            VERDICT, COUNT, "Observations that a machine without errors fits clearly better contradict the rest."),
        "lack-of-fit-by-repeats": Rule(
            VERDICT, "ratio of variances", "Residuals that exceed the scatter of repeated poses are unexplained.",
            _decided("LEAST_P_VALUE", "MISFIT_RATIO") + _in("results.pure_error", "LEAST"),
        ),
        "lack-of-fit-by-declared-uncertainty": Rule(
            VERDICT, "reduced chi-squared",
            "Without repeats, residuals that exceed the declared uncertainty are unexplained.",
            _decided("LEAST_P_VALUE", "MISFIT_RATIO"),
        ),
        "few-degrees-of-freedom": Rule(
            VERDICT, COUNT, "With few degrees of freedom left, what is left cannot be told from noise: not judged.",
            _in("results.verdict", "FEW_DOF"),
        ),
        "serial-correlation": Rule(
            VERDICT, "um", "Residuals most of which wander along the rows are unexplained.",
            _decided("STEADY_UM") + _in("results.wandering", "MOST"),
        ),
        "wandering-motion": Rule(
            VERDICT, CHANCE, "A motion that wanders in time more than correlated noise does is unexplained.",
            _decided("LEAST_P_VALUE"),
        ),
        "goes-on": Rule(
            VERDICT, CHANCE, "A motion whose neighbouring rows are independent does not wander: it does not repeat.",
            _decided("LEAST_P_VALUE"),
        ),
        "motion-in-turns": Rule(
            VERDICT, CHANCE, "A motion that repeats after two to four rows is unexplained.", _decided("LEAST_P_VALUE")
        ),
        "non-repeatable-motion": Rule(
            VERDICT, GAIN, "A motion that varies from row to row with its levers is unexplained.",
            _decided("DECISIVE_ODDS") + _in(_NOISE, "CLEAR", "FEWEST"),
        ),
        "non-repeatable-direction": Rule(
            VERDICT, SHARE, "One that only one direction shows must have half of the variance.",
            _in("results.non_repeatable_motion", "LARGE"),
        ),
        "wanders-instead": Rule(
            VERDICT, EVIDENCE,
            "A finding is left out if a motion that wanders has clearly more evidence, and leaves it less than half.",
            _decided("DECISIVE_ODDS", "NEAR", "EVEN", "LEAST_EVIDENCE"),
        ),
        "wave-of-two-joints": Rule(
            VERDICT, CHANCE,
            "What repeats with two joints' positions together is tried at all places, and else unexplained.",
            _decided("LEAST_P_VALUE", "LEAST_SHARE")
            + _in("results.combined_waves", "LEAST_WAVES", "MOST_WAVES", "FEWEST_VALUES", "MOST_JOINTS"),
        ),
        "dependence-of-residuals": Rule(
            VERDICT, CHANCE, "What is left is unexplained if one or two recorded channels predict it.",
            _decided("LEAST_P_VALUE", "LEAST_SHARE"),
        ),
    }
)  # fmt: skip
