"""A light mesh straight from a dense cloud: a mesh of some of its points, collapsed by the quadrics of all points."""
