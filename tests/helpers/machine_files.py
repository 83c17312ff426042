"""Text of machine files."""

from __future__ import annotations

from errormodel import machine_file as schema
from errormodel import yamlfile
from errormodel.machine import Machine

GANTRY = """errormodel: 1
name: Small H-gantry
chain:
  - {joint: Y, type: prismatic, axis: y, travel: [-350, 50]}
  - {shape: beam}
  - {joint: X, type: prismatic, axis: x, travel: [-300, 300]}
errors:
  shapes: none
  joints: {Y: {polynomial: 1}, X: none}
"""
EXAMPLE = """\
errormodel: 1
name: Horizontal machining centre with rotary table and quill
units: {length: mm, angle: deg}
chain:
  - {joint: B, type: rotary,    axis: y,  travel: [0, 360]}
  - {shape: T1, offset: [0, 0, 0]}
  - {joint: X, type: prismatic, axis: x,  travel: [-1250, 1250]}
  - {shape: T2, offset: [0, 0, 0], rotation: [0, 0, 90]}
  - {joint: Z, type: prismatic, axis: -z,  travel: [900, 2200]}
  - {shape: T3, offset: [1, 2, 3]}
  - {joint: W, type: prismatic, axis: [0, 0.6, 0.8], travel: [-800, -200]}
tool: [0, 0, -312.035]
errors:
  shapes: {T1: [ea, dx], T2: all}
  joints:
    B: {harmonic: 2}
    X: first-order
    Z: {polynomial: 3, ezz: {polynomial: 5}, EAZ: none}
    W: {all: first-order, dx: {spline: 4}}
effects:
  - {effect: ram-sag, joint: W, exponent: 2.5}
notes: A note.
"""

PLAIN = """\
errormodel: 1
chain:
  - {joint: X, type: prismatic, axis: x, travel: [0, 500]}
  - {shape: T1, offset: [0, 0, 100]}
  - {joint: C, type: rotary, axis: z, travel: [0, 360]}
tool: [0, 0, 50]
"""


def read(text: str) -> Machine:
    return schema.resolve(yamlfile.parse(text, "machine.yaml"))
