// Our own hierarchy over the faces of the boundary: a node is the box around 32 that follow each other, of
// nodes of the level below, or of faces at the lowest. As faces lie in Morton order, these are next to each
// other, and nothing is sorted, split or linked. Heights count from the faces.

// Children of a node.
const uint WIDTH = 32;
const uint LOG_WIDTH = 5;
const uint MAX_HEIGHT = 6;
// Nodes of levels above, by the number of these levels.
const uint NODES_ABOVE[MAX_HEIGHT] = uint[](0u, 1u, 33u, 1057u, 33825u, 1082401u);

// Macrocells' planes around something, both included.
struct Bounds {
    uvec3 lo;
    uvec3 hi;
};

// Nodes of a height, or faces.
uint num_at(uint height) {
    uint shift = LOG_WIDTH * height;
    return (parameters.num_shapes + (1u << shift) - 1) >> shift;
}

uint first_word(uint height, uint node) {
    return 3 * (NODES_ABOVE[parameters.tree_height - height] + node);
}

// A face's plane number and the macrocell that it belongs to, along its axis and the two that follow.
uvec3 place_of_face(uint face, out int axis, out bool looks_up) {
    uint word = parameters.faces.word[3 * face];
    axis = int(word & 3u);
    looks_up = (word & 4u) != 0;
    return uvec3(
        word >> 3, parameters.faces.word[3 * face + 1], parameters.faces.word[3 * face + 2]
    );
}

Bounds bounds_of_face(uint face) {
    int axis;
    bool looks_up;
    uvec3 place = place_of_face(face, axis, looks_up);
    uvec3 ahead = uvec3(0, 1, 1);
    // From (axis, next, next but one) to (x, y, z).
    if (axis == 1) {
        place = place.zxy;
        ahead = ahead.zxy;
    } else if (axis == 2) {
        place = place.yzx;
        ahead = ahead.yzx;
    }
    return Bounds(place, place + ahead);
}

Bounds bounds_of_node(uint height, uint node) {
    uint first = first_word(height, node);
    uvec3 words = uvec3(
        parameters.nodes.word[first],
        parameters.nodes.word[first + 1],
        parameters.nodes.word[first + 2]
    );
    return Bounds(words & 0xffffu, words >> 16);
}

Bounds bounds_at(uint height, uint number) {
    if (height == 0) return bounds_of_face(number);
    return bounds_of_node(height, number);
}
