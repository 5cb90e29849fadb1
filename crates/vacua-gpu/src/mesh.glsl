// A packed mesh as it lies in its file: twins of `vacua_pack`'s layout, indices and fields. What the
// host adds is where each sub-mesh's parts begin (`mesh.rs` is the other side of the structs).

#extension GL_EXT_buffer_reference_uvec2 : require
#extension GL_EXT_control_flow_attributes : require

// What a pipeline of meshes is specialised for, besides what all are.
layout(constant_id = 32) const uint VALUE_TYPE = 0;
layout(constant_id = 33) const bool INNER_NODES = true;
layout(constant_id = 34) const bool VARYING = false;
// Kinds of cells that there are.
layout(constant_id = 36) const bool HAS_TETS = true;
layout(constant_id = 37) const bool HAS_OTHERS = true;
// How cells are held; and the kind of all of them, or of all but tetrahedra of packed ones.
layout(constant_id = 38) const uint HELD = 0;
layout(constant_id = 39) const uint ONLY_KIND = 4;

// As they are packed; or in the encodings that those are compared with: a plain list of them, with
// their boxes in an acceleration structure; tetrahedra that share faces, all of them in one;
// tetrahedra with their neighbours, and the faces that have none in one.
const uint HELD_PACKED = 0;
const uint HELD_IN_BOXES = 1;
const uint HELD_BY_FACES = 2;
const uint HELD_BY_NEIGHBOURS = 3;
const bool IS_PLAIN = HELD != HELD_PACKED;

// Types of values, by number.
const uint VALUE_F32 = 0;
const uint VALUE_U8 = 1;
const uint VALUE_I8 = 2;
const uint VALUE_U16 = 3;
const uint VALUE_I16 = 4;

// Kinds of cells, by `CellType`'s number.
const uint TETRAHEDRON = 0;
const uint PYRAMID = 1;
const uint WEDGE = 2;
const uint HEXAHEDRON = 3;
// Of a list: there are several of them.
const uint MIXED = 4;

// Index of no vertex, which fills pyramids and wedges up.
const uint MARKER = 0xffffu;
// What a sub-mesh holds: indices that fill cells up; other cells than tetrahedra.
const uint HAS_MARKER = 1;
const uint HOLDS_OTHERS = 2;
// No cell.
const uint NO_CELL = 0xffffffffu;
// Divisions of a node's box along an axis.
const uint CHILD_DIVISIONS = 16;
// Sub-meshes that have a box around them all.
const uint GROUP_PARTS = 32;
// Words of a multi-leaf, and of a multi-node.
const uint LEAF_WORDS = 12;
const uint NODE_WORDS = 13;

layout(buffer_reference, std430, buffer_reference_align = 4) readonly buffer MeshWords {
    uint word[];
};
layout(buffer_reference, std430, buffer_reference_align = 4) readonly buffer MeshNumbers {
    float number[];
};

struct Submesh {
    // Box around its cells, in the mesh's own space.
    vec4 lo;
    vec4 hi;
    // Corner of its grid, and sixteenths of a step of it per unit of length.
    vec4 base;
    vec4 sixteenths;
    // Its parts; values of points, or of cells.
    MeshWords nodes;
    MeshNumbers positions;
    MeshWords indices;
    MeshWords values;
    // Cells in nodes before each one, for fields on cells; in plain lists of cells of several kinds
    // four times where each one's indices begin, and its kind.
    MeshWords cells_before;
    // Values to leave out before its first one.
    uint first_value;
    uint num_nodes;
    uint num_vertices;
    uint num_indices;
    // What it holds, as bits.
    uint kinds;
    // Number of its first node among those of all.
    uint first_node;
};

layout(buffer_reference, std430, buffer_reference_align = 16) readonly buffer Submeshes {
    Submesh submesh[];
};

layout(buffer_reference, std430, buffer_reference_align = 16) buffer Mesh {
    // Lower corner of ray space in the mesh's own space; w: side of a unit cube of ray space there.
    vec4 corner;
    // What rounding can move a computed place by; w: a power of two that makes the mesh about 1.
    vec4 slack;
    Submeshes submeshes;
    // Smallest cells in boxes of ray space, level by level.
    Numbers minima;
    // Boxes around groups of sub-meshes, two corners each.
    Quads groups;
    // Of tetrahedra by four: their faces, or their neighbours, opposite each corner; and of faces by two
    // the tetrahedra on the side of their normals and behind, or of those without a neighbour theirs.
    MeshWords links;
    MeshWords sides;
    uint num_submeshes;
    // Cubes of ray space along each axis, for the first level.
    uint minima_x;
    uint minima_y;
    uint minima_z;
    // Set where a search found no room.
    uint overflow;
    // Set where a node or an index points out of its sub-mesh.
    uint damage;
};

Mesh mesh_of(uvec2 address) {
    return Mesh(address);
}

// A place in the mesh's own space from one in ray space: rounded once.
vec3 mesh_place(Mesh mesh, vec3 at) {
    vec4 corner = mesh.corner;
    precise vec3 place = fma(at, vec3(corner.w), corner.xyz);
    return place;
}

vec3 vertex_at(Submesh part, uint vertex) {
    uint first = 3 * vertex;
    return vec3(
        part.positions.number[first],
        part.positions.number[first + 1],
        part.positions.number[first + 2]
    );
}

// Five indices from a place on, of which tetrahedra on their own need four.
void five_indices(Submesh part, uint place, out uint five[5]) {
    uint first = place >> 1;
    uvec3 words = uvec3(
        part.indices.word[first],
        part.indices.word[first + 1],
        part.indices.word[first + 2]
    );
    if ((place & 1u) != 0u) {
        words = uvec3(
            words.x >> 16 | words.y << 16,
            words.y >> 16 | words.z << 16,
            words.z >> 16
        );
    }
    five[0] = words.x & 0xffffu;
    five[1] = words.x >> 16;
    five[2] = words.y & 0xffffu;
    five[3] = words.y >> 16;
    five[4] = words.z & 0xffffu;
}

uint num_corners(uint kind) {
    return kind == HEXAHEDRON ? 8 : kind == WEDGE ? 6 : kind == PYRAMID ? 5 : 4;
}

// The kind of a cell of a plain list, and where its indices, of 32 bits, begin.
uvec2 plain_cell(Submesh part, uint cell) {
    if (ONLY_KIND != MIXED) return uvec2(ONLY_KIND, cell * num_corners(ONLY_KIND));
    uint start = part.cells_before.word[cell];
    return uvec2(start & 3u, start >> 2);
}

// Vertices of a tetrahedron: `primitive` is twice its first index, one more for the second of a
// pair `a b c d e`, which stands for `a b c d` and `a c b e`; in a plain list its number.
uvec4 tet_vertices(Submesh part, uint primitive) {
    if (IS_PLAIN) {
        uint first = plain_cell(part, primitive).y;
        return uvec4(
            part.indices.word[first],
            part.indices.word[first + 1],
            part.indices.word[first + 2],
            part.indices.word[first + 3]
        );
    }
    uint five[5];
    five_indices(part, primitive >> 1, five);
    bool is_second = (primitive & 1u) != 0u;
    return is_second ? uvec4(five[0], five[2], five[1], five[4])
                     : uvec4(five[0], five[1], five[2], five[3]);
}

uint index_at(Submesh part, uint place) {
    return part.indices.word[place >> 1] >> (16 * (place & 1u)) & 0xffffu;
}

// A cell that is no tetrahedron: its kind, and its vertices, past its own the last one again.
struct Other {
    uint kind;
    uint vertices[8];
};

// The cell of eight indices from a place on: the number of markers at their end says its kind.
Other other_at(Submesh part, uint place) {
    uint first = place >> 1;
    bool is_odd = (place & 1u) != 0u;
    uint words[5];
    for (uint k = 0; k < 5; ++k) words[k] = part.indices.word[first + k];
    Other other;
    for (uint k = 0; k < 4; ++k) {
        uint word = is_odd ? words[k] >> 16 | words[k + 1] << 16 : words[k];
        other.vertices[2 * k] = word & 0xffffu;
        other.vertices[2 * k + 1] = word >> 16;
    }
    other.kind = ONLY_KIND;
    if (ONLY_KIND == HEXAHEDRON) return other;
    bool is_filled = (part.kinds & HAS_MARKER) != 0u && other.vertices[7] == MARKER;
    bool is_pyramid = is_filled && other.vertices[5] == MARKER;
    other.kind = !is_filled ? HEXAHEDRON : is_pyramid ? PYRAMID : WEDGE;
    if (is_pyramid) other.vertices[5] = other.vertices[4];
    if (is_filled) {
        other.vertices[6] = other.vertices[5];
        other.vertices[7] = other.vertices[5];
    }
    return other;
}

// The cell that a primitive is, if it is no tetrahedron.
Other other_of(Submesh part, uint primitive) {
    if (!IS_PLAIN) return other_at(part, primitive >> 1);
    uvec2 found = plain_cell(part, primitive);
    Other other;
    other.kind = found.x;
    uint last = num_corners(found.x) - 1;
    for (uint k = 0; k < 8; ++k) other.vertices[k] = part.indices.word[found.y + min(k, last)];
    return other;
}

// A value as it is rendered.
float stored_value(Submesh part, uint place) {
    uint at = part.first_value + place;
    float value;
    if (VALUE_TYPE == VALUE_F32) {
        value = uintBitsToFloat(part.values.word[at]);
    } else if (VALUE_TYPE == VALUE_U8) {
        value = float(part.values.word[at >> 2] >> (8 * (at & 3u)) & 255u);
    } else if (VALUE_TYPE == VALUE_I8) {
        value = float(bitfieldExtract(int(part.values.word[at >> 2]), int(8 * (at & 3u)), 8));
    } else if (VALUE_TYPE == VALUE_U16) {
        value = float(part.values.word[at >> 1] >> (16 * (at & 1u)) & 0xffffu);
    } else {
        value = float(bitfieldExtract(int(part.values.word[at >> 1]), int(16 * (at & 1u)), 16));
    }
    return value;
}

bool is_number(float value) {
    return (floatBitsToUint(value) & 0x7f800000u) != 0x7f800000u;
}

// A child of a node, decoded.
struct Child {
    // In sixteenths of a step of the sub-mesh's grid: whole numbers below 2^24, exact.
    vec3 lo;
    vec3 hi;
    // 0 for inner nodes and for what is not there.
    uint counts;
    bool is_inner;
};

uint node_words() {
    return INNER_NODES ? NODE_WORDS : LEAF_WORDS;
}

// A byte of eight from word `first` on.
uint byte_at(Submesh part, uint first, uint child) {
    return part.nodes.word[first + (child >> 2)] >> (8 * (child & 3u)) & 255u;
}

uint counts_of(Submesh part, uint node, uint child) {
    return byte_at(part, node * node_words() + 10, child);
}

Child child_at(Submesh part, uint node, uint child) {
    uint first = node * node_words();
    uvec3 box = uvec3(
        part.nodes.word[first],
        part.nodes.word[first + 1],
        part.nodes.word[first + 2]
    );
    vec3 lo = vec3(box.x & 0xffffu, box.x >> 16, box.y & 0xffffu);
    vec3 hi = vec3(box.y >> 16, box.z & 0xffffu, box.z >> 16);
    vec3 width = max(hi - lo, vec3(0.0));
    uvec3 bytes = uvec3(
        byte_at(part, first + 4, child),
        byte_at(part, first + 6, child),
        byte_at(part, first + 8, child)
    );
    Child found;
    precise vec3 from = lo * float(CHILD_DIVISIONS);
    precise vec3 child_lo = fma(width, vec3(bytes & 15u), from);
    precise vec3 child_hi = fma(width, vec3(bytes >> 4) + 1.0, from);
    found.lo = child_lo;
    found.hi = child_hi;
    found.counts = counts_of(part, node, child);
    found.is_inner = found.counts == 0 && (bytes.x & 15u) <= bytes.x >> 4;
    return found;
}

uint first_index_of(Submesh part, uint node) {
    return part.nodes.word[node * node_words() + 3];
}

uint first_child_of(Submesh part, uint node) {
    return INNER_NODES ? part.nodes.word[node * NODE_WORDS + 12] : 0;
}

// Indices that the primitives of a leaf take, by its counts.
uint leaf_indices(uint counts) {
    return 4 * (counts & 3u) + 5 * (counts >> 2 & 15u) + 8 * (counts >> 6);
}

uint leaf_tets(uint counts) {
    return (counts & 3u) + 2 * (counts >> 2 & 15u);
}

// A place in sixteenths of a sub-mesh's grid. Rounding is monotone and planes are exact, so that no
// place changes its side of a plane.
vec3 grid_place(Submesh part, vec3 place) {
    precise vec3 at = (place - part.base.xyz) * part.sixteenths.xyz;
    return at;
}

// How many cells of a node come before a primitive.
uint cells_before_in_node(Submesh part, uint node, uint primitive) {
    uint place = primitive >> 1;
    uint first = first_index_of(part, node);
    uint cells = 0;
    for (uint child = 0; child < 8; ++child) {
        uint counts = counts_of(part, node, child);
        uint words = leaf_indices(counts);
        if (place >= first + words) {
            first += words;
            cells += leaf_tets(counts) + (counts >> 6);
            continue;
        }
        uint word = place - first;
        uint tets = counts & 3u;
        uint pairs = counts >> 2 & 15u;
        if (word < 4 * tets) return cells + word / 4;
        word -= 4 * tets;
        if (word < 5 * pairs) return cells + tets + 2 * (word / 5) + (primitive & 1u);
        return cells + tets + 2 * pairs + (word - 5 * pairs) / 8;
    }
    return cells;
}

// The value of a cell, for fields on cells.
float cell_value(Submesh part, uint node, uint primitive) {
    uint before = part.cells_before.word[node] + cells_before_in_node(part, node, primitive);
    return stored_value(part, before);
}

// What a lane looks for: a line through its samples, and which of a block they are.
struct Segment {
    vec3 first;
    vec3 last;
    uint begin;
    // Steps from first to last.
    float steps;
    uint mask;
};
