"""Posterior distribution of a fit: closed form where Gaussian, quadrature over one hyperparameter, else emcee.

Given noise levels, shape parameters of effects and scales of random effects, the parameters of the error model are
Gaussian and integrated out; only these hyperparameters are sampled. Log-probabilities need sufficient statistics only,
which are gathered in one pass over the rows.
"""
