"""A light mesh straight from a dense cloud: a mesh of some of its points, collapsed by the quadrics of all points.

In all files, `faces` are triangles between vertices, (F, 3), and `vertices` and `normals` belong to the vertices,
(V, 3). The dense `points` are (N, 3), or (n, 3) where only some of them are meant.
"""
