// The cell at a place, one thread on its own: the literal twin of `vacua_pack::Locator`, which the
// search that a subgroup makes together is compared with.

const uint LOCATE_STACK = 96;

// Of several cells that accept a place, the one with the lowest packed index.
bool locate(
    Mesh mesh,
    vec3 place,
    out uint number,
    out uint primitive,
    out uint of_node,
    out bool is_other
) {
    primitive = NO_CELL;
    of_node = 0;
    is_other = false;
    uint stack[LOCATE_STACK];
    for (number = 0; number < mesh.num_submeshes; ++number) {
        Submesh part = mesh.submeshes.submesh[number];
        if (!in_box(place, part.lo.xyz, part.hi.xyz)) continue;
        vec3 at = grid_place(part, place);
        uint waiting = 1;
        stack[0] = 0;
        while (waiting > 0) {
            uint node = stack[--waiting];
            uint first_index = first_index_of(part, node);
            uint inner = first_child_of(part, node);
            for (uint k = 0; k < 8; ++k) {
                Child child = child_at(part, node, k);
                bool is_hit = in_box(at, child.lo, child.hi);
                if (child.is_inner) {
                    if (is_hit && waiting < LOCATE_STACK) stack[waiting++] = inner;
                    else if (is_hit) mesh.overflow = 1;
                    ++inner;
                    continue;
                }
                uint first = first_index;
                first_index += leaf_indices(child.counts);
                if (!is_hit) continue;
                uint tets = child.counts & 3u;
                uint both = leaf_tets(child.counts);
                for (uint i = 0; i < both; ++i) {
                    uint pair = i - tets;
                    uint here = i < tets ? 2 * (first + 4 * i)
                                         : 2 * (first + 4 * tets + 5 * (pair >> 1)) + (pair & 1u);
                    if (here >= primitive) continue;
                    uvec4 vertices;
                    vec3 corners[4];
                    tet_corners(part, here, vertices, corners);
                    if (!tet_accepts(place, corners, mesh.slack.w)) continue;
                    primitive = here;
                    of_node = node;
                    is_other = false;
                }
                first += 4 * tets + 5 * (child.counts >> 2 & 15u);
                for (uint i = 0; i < child.counts >> 6; ++i) {
                    uint here = 2 * (first + 8 * i);
                    uint kind;
                    Weights weights;
                    if (here >= primitive) continue;
                    if (!other_accepts(part, here, place, kind, weights)) continue;
                    primitive = here;
                    of_node = node;
                    is_other = true;
                }
            }
        }
        if (primitive != NO_CELL) return true;
    }
    return false;
}
