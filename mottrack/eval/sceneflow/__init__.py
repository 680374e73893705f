"""Scene flow evaluation as Argoverse 2's challenges define it, on any data set with tracks."""
