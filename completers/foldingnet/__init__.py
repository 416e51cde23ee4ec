"""FoldingNet (Yang et al. 2018), patch by patch: a code of each patch, and a grid that is folded by it twice."""
