// The cell at a place, one thread on its own: the twin of `vacua_pack::Locator`. The search that a subgroup
// makes together is compared with it, and for places all over a mesh it is faster.

const uint LOCATE_STACK = 96;

// A cell, and where it is.
struct Cell {
    // Number of its sub-mesh; primitive, node and kind there.
    uint number;
    uint primitive;
    uint node;
    bool is_other;
};

// Tries the cells of a leaf, whose primitives begin at an index, that come before the cell so far.
void try_leaf(Mesh mesh, Submesh part, vec3 place, uint node, uint first, uint counts, inout Cell cell) {
    uint tets = counts & 3u;
    uint both = leaf_tets(counts);
    for (uint i = 0; i < both; ++i) {
        uint pair = i - tets;
        uint here = i < tets ? 2 * (first + 4 * i)
                             : 2 * (first + 4 * tets + 5 * (pair >> 1)) + (pair & 1u);
        if (here >= cell.primitive) continue;
        uvec4 vertices;
        vec3 corners[4];
        tet_corners(part, here, vertices, corners);
        if (!tet_accepts(place, corners, mesh.slack.w)) continue;
        cell.primitive = here;
        cell.node = node;
        cell.is_other = false;
    }
    first += 4 * tets + 5 * (counts >> 2 & 15u);
    for (uint i = 0; i < counts >> 6; ++i) {
        uint here = 2 * (first + 8 * i);
        if (here >= cell.primitive) continue;
        Other other = other_at(part, here >> 1);
        Weights weights;
        if (!other_accepts(part, other, place, weights)) continue;
        cell.primitive = here;
        cell.node = node;
        cell.is_other = true;
    }
}

// Children of a node that a place is in: inner ones go to the stack, leaves are given back as bits.
uint leaves_at(
    Mesh mesh,
    Submesh part,
    vec3 at,
    uint node,
    inout uint stack[LOCATE_STACK],
    inout uint waiting
) {
    uint inner = first_child_of(part, node);
    uint leaves = 0;
    for (uint k = 0; k < 8; ++k) {
        Child child = child_at(part, node, k);
        bool is_hit = in_box(at, child.lo, child.hi);
        if (child.is_inner) {
            if (is_hit && waiting < LOCATE_STACK) stack[waiting++] = inner;
            else if (is_hit) mesh.overflow = 1;
            ++inner;
        } else if (is_hit && child.counts != 0) {
            leaves |= 1u << k;
        }
    }
    return leaves;
}

// Searches a sub-mesh. Threads beside this one look at other nodes: all go on until each has leaves, then all
// try those.
void locate_in(Mesh mesh, Submesh part, vec3 place, inout Cell cell) {
    uint stack[LOCATE_STACK];
    vec3 at = grid_place(part, place);
    uint waiting = 1;
    stack[0] = 0;
    uint leaves = 0;
    uint node = 0;
    while (true) {
        while (leaves == 0 && waiting > 0) {
            node = stack[--waiting];
            leaves = leaves_at(mesh, part, at, node, stack, waiting);
        }
        if (leaves == 0) return;
        uint leaf = uint(findLSB(leaves));
        leaves &= leaves - 1;
        uint first = first_index_of(part, node);
        for (uint k = 0; k < leaf; ++k) first += leaf_indices(counts_of(part, node, k));
        try_leaf(mesh, part, place, node, first, counts_of(part, node, leaf), cell);
    }
}

// Of several cells that accept a place, the one with the lowest packed index.
bool locate(Mesh mesh, vec3 place, out Cell cell) {
    cell = Cell(0, NO_CELL, 0, false);
    while (true) {
        // Each thread finds a sub-mesh of its own before any goes into one.
        for (; cell.number < mesh.num_submeshes; ++cell.number) {
            vec3 lo = mesh.submeshes.submesh[cell.number].lo.xyz;
            vec3 hi = mesh.submeshes.submesh[cell.number].hi.xyz;
            if (in_box(place, lo, hi)) break;
        }
        if (cell.number == mesh.num_submeshes) return false;
        locate_in(mesh, mesh.submeshes.submesh[cell.number], place, cell);
        if (cell.primitive != NO_CELL) return true;
        ++cell.number;
    }
}
