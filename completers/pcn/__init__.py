"""PCN (Yuan et al. 2018), patch by patch: a code of each patch, coarse points of it, a small grid folded at each."""
