// The cell at a place by an acceleration structure over the multi-leaves of all sub-meshes, or over the
// cells of a plain list: a ray of no length to speak of meets the boxes that the place is in (paper B
// §5.5; Wald et al. 2019).

// Where such rays go: along no axis, as boxes may have no width.
const vec3 EPSILON_DIRECTION = vec3(0.48, 0.6, 0.64);

// The sub-mesh that holds a node, by its number among those of all.
uint part_of_node(Mesh mesh, uint node) {
    uint first = 0;
    uint end = mesh.num_submeshes;
    while (end - first > 1) {
        uint middle = (first + end) >> 1;
        if (mesh.submeshes.submesh[middle].first_node <= node) first = middle;
        else end = middle;
    }
    return first;
}

// Tries the cells of a multi-leaf that come before the cell so far.
void try_node(Mesh mesh, vec3 place, uint node_of_all, inout Cell cell) {
    uint number = part_of_node(mesh, node_of_all);
    bool is_first = cell.primitive == NO_CELL || number < cell.number;
    if (!is_first && number > cell.number) return;
    Submesh part = mesh.submeshes.submesh[number];
    uint node = node_of_all - part.first_node;
    vec3 at = grid_place(part, place);
    Cell own = is_first ? Cell(number, NO_CELL, 0, false) : cell;
    uint first = first_index_of(part, node);
    for (uint k = 0; k < 8; ++k) {
        Child child = child_at(part, node, k);
        if (in_box(at, child.lo, child.hi)) {
            try_leaf(mesh, part, place, node, first, child.counts, own);
        }
        first += leaf_indices(child.counts);
    }
    if (own.primitive != NO_CELL) cell = own;
}

// Tries a cell of a plain list, if it comes before the cell so far.
void try_cell(Mesh mesh, vec3 place, uint number, inout Cell cell) {
    if (number >= cell.primitive) return;
    Submesh part = mesh.submeshes.submesh[0];
    bool is_other = HAS_OTHERS && (!HAS_TETS || plain_cell(part, number).x != TETRAHEDRON);
    if (is_other) {
        Weights weights;
        if (!other_accepts(part, other_of(part, number), place, weights)) return;
    } else {
        uvec4 vertices;
        vec3 corners[4];
        tet_corners(part, number, vertices, corners);
        if (!tet_accepts(place, corners, mesh.slack.w)) return;
    }
    cell = Cell(0, number, 0, is_other);
}

// Tries what a box is around.
void try_shape(Mesh mesh, vec3 place, uint shape, inout Cell cell) {
    if (IS_PLAIN) try_cell(mesh, place, shape, cell);
    else try_node(mesh, place, shape, cell);
}
