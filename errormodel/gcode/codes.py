"""Words of each dialect with their modal groups, and reasons for refusing others. Any word in no table is refused.

Sources: NIST IR 6556, tables 4 (modal groups), 5 and 7 (G and M codes); LinuxCNC manual, "G codes" and "M codes"; FANUC
Series 30i operator's manual B-64484EN (preparatory functions); Marlin documentation, "G-code index"; RepRap wiki,
"G-code"; Klipper documentation, "G-Codes".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

MOTION = "motion"
ORIGINS = ("G54", "G55", "G56", "G57", "G58", "G59")  # work offsets
_FOR_ALL = {
    "G0": MOTION, "G1": MOTION, "G2": MOTION, "G3": MOTION,
    "G17": "plane", "G18": "plane", "G19": "plane",
    "G20": "units", "G21": "units", "G90": "distance", "G91": "distance",
    "G4": "one line", "G28": "one line",
}  # fmt: skip
_MILLING = _FOR_ALL | {
    "G80": MOTION, **dict.fromkeys(("G73", "G81", "G82", "G83", "G85", "G89"), MOTION),
    "G93": "feed mode", "G94": "feed mode", "G95": "feed mode", "G40": "cutter radius",
    "G43": "tool length", "G49": "tool length", **dict.fromkeys(ORIGINS, "work offset"),
    "G61": "path", "G64": "path", "G97": "spindle", "G98": "return", "G99": "return",
    "G30": "one line", "G53": "one line", "G69": "rotation",
}  # fmt: skip
_STOPS = dict.fromkeys(("M0", "M1", "M2", "M30"), "stop")
_MILLING_M = _STOPS | {
    **dict.fromkeys(("M3", "M4", "M5", "M19"), "spindle"),
    "M7": "mist", "M8": "coolant", "M9": "coolant", "M48": "override", "M49": "override", "M6": "tool",
}  # fmt: skip
_QUIET = (
    "M0 M1 M2 M30 M3 M4 M5 M73 M82 M83 M104 M105 M106 M107 M108 M109 M110 M113 M114 M115 M117 M118 M140 M141 M155 M190 "
    "M191 M201 M203 M204 M205 M220 M221 M300 M302 M400 M572 M593 M862.1 M862.2 M862.3 M862.4 M862.5 M862.6 M900"
)
_PRINTING_M = dict.fromkeys(_QUIET.split(), "printer") | {"M17": "motors", "M18": "motors", "M84": "motors"}

STOP_CODES = frozenset(_STOPS)  # carried out after the block's motion: NIST IR 6556, table 8
END_CODES = frozenset({"M2", "M30"})  # end of the programme
PLANES = {"G17": ("X", "Y", "I", "J", "K"), "G18": ("Z", "X", "K", "I", "J"), "G19": ("Y", "Z", "J", "K", "I")}
PECK_CYCLES = frozenset({"G73", "G83"})
EXACT_STOPS = frozenset({"G9", "G61", "G61.1"})  # an exact stop at the end of every block

_ROTATED = "Write the programme without rotation, scaling and mirroring"
_CYCLE = "Write the cycle as single moves (most CAM systems can)"
_CALL = "Write the programme without calls and macros (most CAM systems can)"
_RADIUS = "Write the path of the tool's centre"
_PROBE = "Leave probing in a programme of its own: where it ends is not known before"
_OFFSET = "Write one of G54 to G59, and give it as --offset G54=X..,Y..,Z.."
REFUSED: Mapping[str, tuple[str, str]] = {
    **{f"G{g}": (f"a canned cycle (G{g})", _CYCLE) for g in (73, 74, 76, *range(81, 90))},
    **{f"G{g}": (f"cutter radius compensation (G{g})", _RADIUS) for g in ("41", "42", "41.1", "42.1")},
    "G43.4": ("tool centre point control (G43.4)", "Write positions of the axes"),
    "G43.5": ("tool centre point control (G43.5)", "Write positions of the axes"),
    "G43.1": ("a tool length without a number (G43.1)", "Write G43 with H"),
    "G43.2": ("an added tool length (G43.2)", "Write G43 with H"),
    "G44": ("a negative tool length (G44)", "Write G43"),
    "G5": ("a spline or high-speed mode (G5)", "Write lines and arcs"),
    "G5.1": ("a spline or look-ahead mode (G5.1)", "Write lines and arcs"),
    "G6.2": ("a NURBS curve (G6.2)", "Write lines and arcs"),
    "G7": ("diameters (G7)", "Write radii"),
    "G10": ("data setting (G10)", "Set offsets at the control, and give them as --offset"),
    "G16": ("polar coordinates (G16)", "Write X and Y"),
    "G31": ("skipping or probing (G31)", _PROBE),
    "G32": ("threading (G32)", "Leave threads in a programme of their own"),
    "G33": ("threading (G33)", "Leave threads in a programme of their own"),
    "G33.1": ("rigid tapping (G33.1)", "Leave threads in a programme of their own"),
    **{f"G38.{k}": (f"probing (G38.{k})", _PROBE) for k in range(2, 6)},
    "G50": ("a scaling or spindle limit (G50)", _ROTATED),
    "G50.1": ("mirroring (G50.1)", _ROTATED),
    "G51": ("scaling (G51)", _ROTATED),
    "G51.1": ("mirroring (G51.1)", _ROTATED),
    "G52": ("a local coordinate shift (G52)", _OFFSET),
    "G54.1": ("an additional work offset (G54.1)", _OFFSET),
    "G54.2": ("a fixture offset (G54.2)", _OFFSET),
    "G65": ("a macro call (G65)", _CALL),
    "G66": ("a modal macro call (G66)", _CALL),
    "G68": ("rotation (G68)", _ROTATED),
    "G68.2": ("a tilted plane (G68.2)", "Write positions of the axes"),
    "G92": ("a shift of the coordinates (G92)", _OFFSET),
    "G92.1": ("a shift of the coordinates (G92.1)", _OFFSET),
    "G96": ("constant surface speed (G96)", "Write a spindle speed with G97"),
    "M97": ("a subprogramme call (M97)", _CALL),
    "M98": ("a subprogramme call (M98)", _CALL),
    "M99": ("a return from a subprogramme (M99)", _CALL),
    "M60": ("a change of pallets (M60)", "Write a programme for each pallet"),
}  # fmt: skip


@dataclass(frozen=True)
class Dialect:
    """Words that a family of controls has.

    Attributes
    ----------
    groups : modal group of every known G and M code; two codes of a group exclude each other in a block.
    letters : permitted letters besides N, G, M and the axes.
    extras : parameters that a code may have; any other use of these letters is refused.
    moving : commands that move axes by rules of their own; the user must state the positions after them.
    """

    name: str
    title: str
    groups: Mapping[str, str]
    letters: str
    extras: Mapping[str, str] = field(default_factory=dict)
    moving: frozenset[str] = frozenset({"M6", "G28", "G30"})
    printer: bool = False
    header: bool = False  # begins with O and a number
    points: bool = False  # a number without a decimal point may count in least increments
    increments: bool = False  # it does, in those of 0.001 mm, 0.001 degrees or 0.0001 inches (IS-B)


_MILL_EXTRAS = {"G4": "P", "G43": "H", "G64": "PQ"}
_FANUC = Dialect(
    "fanuc", "FANUC and the like", _MILLING | _MILLING_M | {"G9": "one line", "G15": "polar", "G67": "macro"},
    "FSTIJKR", _MILL_EXTRAS | {"G4": "PX"}, header=True, points=True,
)  # fmt: skip
DIALECTS: Mapping[str, Dialect] = {
    d.name: d
    for d in (
        Dialect(
            "iso", "RS274/NGC (LinuxCNC and the like)",
            _MILLING | _MILLING_M | {"G8": "diameter", "G59.1": "work offset", "G59.2": "work offset",
            "G59.3": "work offset", "G61.1": "path", "G90.1": "arc distance", "G91.1": "arc distance"},
            "FSTIJKR", _MILL_EXTRAS,
        ),
        _FANUC,
        replace(_FANUC, name="fanuc-calculator", points=False),
        replace(_FANUC, name="fanuc-increments", points=False, increments=True),
        Dialect(
            "printer", "3-D printers (Marlin, Klipper, RepRapFirmware)",
            _FOR_ALL | _PRINTING_M | {"G10": "one line", "G11": "one line", "G29": "one line", "G34": "one line",
            "G80": "one line", "G92": "one line"},
            "FSTIJKRE", {"G4": "P"}, frozenset({"G28", "G29", "G34", "G80", "M17", "M18", "M84"}), printer=True,
        ),
    )
}  # fmt: skip
# both kinds of input exist: FANUC B-64484EN, 3401#0 (DPI), and Haas, setting 162 (default to float)
WHOLE_NUMBERS = (
    "--dialect fanuc-calculator where they are mm (FANUC parameter 3401#0 = 1, Haas setting 162 on), "
    "--dialect fanuc-increments where they are 0.001 mm (0, off)"
)
UNREAD = {
    "siemens": "Siemens programmes are not read here",
    "heidenhain": "Heidenhain programmes are not read here",
}
