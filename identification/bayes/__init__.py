"""The posterior of a fit: exact where it is Gaussian, by quadrature in one dimension, by emcee beyond.

Given noise levels, shapes of effects and scales of ties, the parameters of the error model are Gaussian: they are
integrated out, and only what is not linear is sampled. Everything a log-probability needs are sufficient statistics,
gathered in one stream through the rows.
"""
