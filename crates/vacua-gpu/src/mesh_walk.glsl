// The tetrahedron at a place by way of faces: of a mesh whose tetrahedra share them, a ray to the first one
// says in which it begins; of one whose tetrahedra know their neighbours, rays march from one to the next
// and ask only where they enter and leave. Twin of `vacua_pack::reference`'s march (paper B §6.1.1 and
// Table 6; Morrical et al. 2019; Garrity 1990).
//
// This proposes a tetrahedron. Whoever is clearly inside is done; elsewhere the tetrahedra around are
// tried, of which the lowest that accepts the place wins, as in all encodings.

// Rays that look for faces start this many samples before the place, so that one on the boundary finds
// it.
const float BEFORE = 1e-2;
// Tetrahedra that a ray marches through at once, and tetrahedra around a place that are tried.
const uint MOST_STEPS = 4096;
const uint MOST_AROUND = 96;

// From one sample to the next, in the mesh's own space.
vec3 way;
// The tetrahedron of the sample before, or the one that the ray enters next; NO_CELL for neither.
uint walk_tet;
// Samples from which on the ray is in `walk_tet`, and up to which it is known to be.
float walk_enter;
float walk_until;

// Before the first sample.
void begin_walk() {
    walk_tet = NO_CELL;
    walk_enter = -LARGEST;
    walk_until = -LARGEST;
}

// The face that a ray meets first that starts so many samples before a place; false if there is none. Its
// number, samples from the place up to it, and whether it is met in front.
bool first_face(vec3 place, float before, out uvec3 face);

// The tetrahedra before and behind a face that is met.
uvec2 beside_face(Mesh mesh, uint face, bool is_front) {
    uvec2 sides = HELD == HELD_BY_FACES
        ? uvec2(mesh.sides.word[2 * face], mesh.sides.word[2 * face + 1])
        : uvec2(NO_CELL, mesh.sides.word[face]);
    return is_front ? sides : sides.yx;
}

// The neighbours of a tetrahedron opposite its corners.
uvec4 neighbours_of(Mesh mesh, uint tet) {
    uvec4 found;
    for (uint k = 0; k < 4; ++k) {
        uint link = mesh.links.word[4 * tet + k];
        if (HELD == HELD_BY_FACES) {
            uint one = mesh.sides.word[2 * link];
            found[k] = one == tet ? mesh.sides.word[2 * link + 1] : one;
        } else {
            found[k] = link;
        }
    }
    return found;
}

void corners_from(Submesh part, uint tet, vec3 place, out vec3 corners[4]) {
    uvec4 vertices;
    tet_corners(part, tet, vertices, corners);
    for (int k = 0; k < 4; ++k) corners[k] -= place;
}

// The corners of the face opposite a corner.
uvec3 opposite(uint k) {
    return uvec3(k == 0 ? 1 : 0, k < 2 ? 2 : 1, k == 3 ? 2 : 3);
}

// Marches from a tetrahedron on the line through a place, towards the place. False if the mesh is left
// before.
bool march_to(Mesh mesh, Submesh part, vec3 place, vec3 towards, inout uint tet) {
    uint from = NO_CELL;
    for (uint i = 0; i < MOST_STEPS; ++i) {
        vec3 corners[4];
        corners_from(part, tet, place, corners);
        uvec4 neighbours = neighbours_of(mesh, tet);
        float leaves_at = LARGEST;
        uint next = NO_CELL;
        for (uint k = 0; k < 4; ++k) {
            uvec3 face = opposite(k);
            vec3 a = corners[face.x];
            vec3 normal = cross_of(corners[face.y] - a, corners[face.z] - a);
            float rate = dot_of(normal, towards);
            bool is_ahead = dot_of(normal, corners[k] - a) >= 0.0 ? rate < 0.0 : rate > 0.0;
            float t = dot_of(normal, a) / rate;
            bool is_back = neighbours[k] == from && from != NO_CELL;
            if (is_ahead && t < leaves_at && !is_back) {
                leaves_at = t;
                next = neighbours[k];
            }
        }
        // Also where it is left through no face, as flat ones may be.
        if (leaves_at >= 0.0) return true;
        if (next == NO_CELL) return false;
        from = tet;
        tet = next;
    }
    return true;
}

// Asks for the tetrahedron that a sample is in or near, by number along the ray; NO_CELL if there is none.
uint ask(Mesh mesh, Submesh part, vec3 place, float k, float before) {
    uvec3 face;
    if (!first_face(place, before, face)) {
        walk_tet = NO_CELL;
        walk_enter = LARGEST;
        return NO_CELL;
    }
    float t = uintBitsToFloat(face.y);
    uvec2 beside = beside_face(mesh, face.x, face.z != 0);
    bool is_inside = beside.x != NO_CELL;
    walk_tet = is_inside ? beside.x : beside.y;
    walk_enter = is_inside ? k : k + t;
    walk_until = walk_enter;
    if (!is_inside) return t < BEFORE ? walk_tet : NO_CELL;
    // The ray leaves there: of faces alone that says in which one it is, else back to the place.
    if (HELD == HELD_BY_FACES) walk_until = k + t;
    else march_to(mesh, part, place, -way, walk_tet);
    return walk_tet;
}

// The same, by what the ray is known to do already.
uint propose(Mesh mesh, Submesh part, vec3 place, float k) {
    if (k < walk_enter - BEFORE) return NO_CELL;
    if (k <= walk_until) return walk_tet;
    if (HELD == HELD_BY_NEIGHBOURS && walk_tet != NO_CELL) {
        uint tet = walk_tet;
        if (march_to(mesh, part, place, way, tet)) {
            walk_tet = tet;
            return tet;
        }
    }
    return ask(mesh, part, place, k, BEFORE);
}

// Whether a place is in a tetrahedron or about on its surface.
bool touches(Mesh mesh, Submesh part, uint tet, vec3 place) {
    uvec4 vertices;
    vec3 corners[4];
    tet_corners(part, tet, vertices, corners);
    float least;
    float bound;
    tet_verdict(place, corners, mesh.slack.w, least, bound);
    return least >= -4.0 * bound;
}

// Goes to the neighbour behind the face that a place is farthest outside of, until there is none.
uint nearest(Mesh mesh, Submesh part, uint tet, vec3 place) {
    uint from = NO_CELL;
    for (uint i = 0; i < MOST_STEPS && !touches(mesh, part, tet, place); ++i) {
        vec3 corners[4];
        corners_from(part, tet, place, corners);
        uvec4 neighbours = neighbours_of(mesh, tet);
        float least = 0.0;
        uint next = NO_CELL;
        for (uint k = 0; k < 4; ++k) {
            uvec3 face = opposite(k);
            vec3 a = corners[face.x];
            vec3 normal = cross_of(corners[face.y] - a, corners[face.z] - a);
            float side = dot_of(normal, corners[k] - a) >= 0.0 ? 1.0 : -1.0;
            float volume = -side * dot_of(normal, a);
            if (volume < least && neighbours[k] != NO_CELL && neighbours[k] != from) {
                least = volume;
                next = neighbours[k];
            }
        }
        if (next == NO_CELL) break;
        from = tet;
        tet = next;
    }
    return tet;
}

// The lowest tetrahedron that accepts a place, of those around where a walk from a near one ends.
uint settle(Mesh mesh, Submesh part, uint near, vec3 place) {
    uint around[MOST_AROUND];
    around[0] = nearest(mesh, part, near, place);
    uint count = 1;
    uint best = NO_CELL;
    for (uint i = 0; i < count; ++i) {
        uint tet = around[i];
        if (tet < best) {
            uvec4 vertices;
            vec3 corners[4];
            tet_corners(part, tet, vertices, corners);
            if (tet_accepts(place, corners, mesh.slack.w)) best = tet;
        }
        if (i > 0 && !touches(mesh, part, tet, place)) continue;
        uvec4 neighbours = neighbours_of(mesh, tet);
        for (uint k = 0; k < 4; ++k) {
            bool is_new = neighbours[k] != NO_CELL && count < MOST_AROUND;
            for (uint j = 0; j < count && is_new; ++j) is_new = around[j] != neighbours[k];
            if (is_new) around[count++] = neighbours[k];
        }
    }
    return best;
}

// The cell of a sample, by number along the ray; false if there is none.
bool walk_to(Mesh mesh, vec3 place, float k, out Cell cell) {
    Submesh part = mesh.submeshes.submesh[0];
    cell = Cell(0, propose(mesh, part, place, k), 0, false);
    if (cell.primitive == NO_CELL) return false;
    uvec4 vertices;
    vec3 corners[4];
    tet_corners(part, cell.primitive, vertices, corners);
    float least;
    float bound;
    uint verdict = tet_verdict(place, corners, mesh.slack.w, least, bound);
    if (verdict == INSIDE) return true;
    cell.primitive = settle(mesh, part, cell.primitive, place);
    if (cell.primitive != NO_CELL) return true;
    // A ray that started before may have been in another part of the mesh.
    cell.primitive = ask(mesh, part, place, k, 0.0);
    if (cell.primitive != NO_CELL) cell.primitive = settle(mesh, part, cell.primitive, place);
    return cell.primitive != NO_CELL;
}
