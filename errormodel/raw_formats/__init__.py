"""Files as instruments write them, which `errormodel import` reads: one module a format, in `base` the contract."""
