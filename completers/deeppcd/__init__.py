"""DeepPCD (IMWUT 2022): patches of an indoor cloud, related by a transformer, completed by moving plane points."""
