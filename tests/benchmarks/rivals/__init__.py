"""What a user would take instead, one file each.

A rival has ``build(q)``, q being the commands (n, 5) in the order B, X, Z, Y, W in rad and mm, and names the columns it
returns in ``IDS``. Its result can be viewed as (n, 3, len(IDS)) by ``as_design`` if it has one, else by reshaping. It
may limit the poses it is timed on by ``MAX_POSES``: the figure is one a pose.
"""

from __future__ import annotations

# name on the command line: (module, what it is in the table, what to install)
RIVALS = {
    "numpy": ("competent_numpy", "NumPy, tuned: pose as last index", "numpy"),
    "numpy-stacks": ("stacked_numpy", "NumPy, (n, 3, 3) stacks", "numpy"),
    "sympy": ("sympy_rival", "SymPy lambdify, all poses at once", "sympy"),
    "sympy-blocks": ("sympy_blocks", "SymPy lambdify, blocks of poses", "sympy"),
    "numba": ("numba_rival", "Numba, hand-written loop", "numba"),
    "jax": ("jax_rival", "JAX, vmap of jacrev, jit", "jax"),
    "pinocchio": ("pinocchio_rival", "Pinocchio regressor, 30 of its own columns", "pin"),
    "figaroh": ("figaroh_rival", "FIGAROH regressor, 30 of its own columns", "figaroh"),
}
