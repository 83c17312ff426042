"""Offsets from programme positions to those of the axes: work offset and tool length.

Sources: NIST IR 6556, section 3.5.12 (coordinate systems) and 3.5.9 (tool length); FANUC B-64484EN, G43 and G54.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.setup import Setup
from errormodel.exceptions import InputError
from errormodel.gcode.codes import Dialect
from errormodel.gcode.reading import Reading
from errormodel.gcode.words import Block

LENGTH_AXIS = "Z"  # along which G43 takes a tool's length (NIST IR 6556, section 3.5.9)


@dataclass(frozen=True)
class Origins:
    """Offsets stated by the user; `alone`: the programme names one work offset at most; `missing`: not stated."""

    setup: Setup
    reading: Reading
    alone: bool
    missing: tuple[str, ...] = ()

    @classmethod
    def of(cls, setup: Setup, reading: Reading, dialect: Dialect, blocks: Sequence[Block]) -> Origins:
        """Offsets for the blocks of a programme."""
        for name, place in reading.offsets.items():
            shown = ",".join(f"{letter}{value:g}" for letter, value in place.items())
            given = f"--offset {name}={shown}" if name else f"--offset {shown}"
            for letter in place:
                setup.place(letter)  # refuses an axis that the machine does not have
            linear = [a.name for a in setup.axes if not a.rotary]
            needed = [n for n in linear if n not in place] if not name.startswith("H") else []
            if name.startswith("H") and LENGTH_AXIS in linear and LENGTH_AXIS not in place:
                needed = [LENGTH_AXIS]
            if needed:
                found = f"no {', '.join(needed)}, which counts as much as the others"
                raise InputError(given, found, f"Write {', '.join(f'{n}..' for n in needed)} too, 0 where it is none")
        named = {w.code for b in blocks for w in b.words if dialect.groups.get(w.code) == "work offset"}
        alone = len(named) < 2
        known = {*reading.offsets, *(named if "" in reading.offsets and alone else ())}
        lengths = [b.number_of("H") for b in blocks if "G43" in b.codes("G")]
        names = [*sorted(named), *dict.fromkeys(f"H{n:g}" for n in lengths if n is not None)]
        return cls(setup, reading, alone, tuple(n for n in names if n not in known))

    def _others(self, name: str) -> str:
        """The other offsets that the programme names and nobody stated, so that all are given in one go."""
        others = [n for n in self.missing if n != name]
        asked = " ".join(f"--offset {n}={f'{LENGTH_AXIS}..' if n.startswith('H') else 'X..,Y..,Z..'}" for n in others)
        return f"; and for what follows {asked}" if others else ""

    def shift(self, block: Block, origin: str, tool: str) -> Array:
        """Offset (axes,) of a block from programme positions to those of the axes, mm and deg.

        Raises
        ------
        InputError
            The work offset is not known.
        """
        offsets = self.reading.offsets
        usual = "" in offsets and self.alone
        if origin and origin not in offsets and not usual:
            cure = f"Write --offset {origin}=X..,Y..,Z.. (positions of its zero on the axes){self._others(origin)}"
            block.refuse(f"the work offset {origin} is not known", cure)
        if not origin and "" not in offsets and any(n.startswith("G") for n in offsets):
            cure = "Write G54 before the first position, or --offset X..,Y..,Z.. for it"
            block.refuse("the work offset that is active here is not known", cure)
        out = np.zeros(len(self.setup.axes))
        for name in (origin if origin in offsets else "", *([tool] if tool else [])):
            for letter, value in offsets.get(name, {}).items():
                out[self.setup.place(letter)] += value
        return out

    def tool(self, block: Block) -> str:
        """Name of the tool length that G43 takes.

        Raises
        ------
        InputError
            It is not known.
        """
        number = block.number_of("H")
        if number is None:
            block.refuse("a tool length without H", "Write G43 with H")
        name = f"H{number:g}"
        if name not in self.reading.offsets:
            found = f"the tool length {name} is not known"
            block.refuse(found, f"Write --offset {name}=Z.. (Z0 where the work offset holds it){self._others(name)}")
        return name
