"""Volumetric error models of machine tools, CMMs, gantries and arms: predict, never fit.

The way of the data: ``machine.yaml`` -> :class:`~errormodel.machine.Machine` ->
:class:`~errormodel.chain.Chain` (CasADi) -> :class:`~errormodel.kernel.Kernel` (NumPy).
Inference lives in the sister package ``identification``, which imports this one.
"""

__version__ = "0.1.0"
