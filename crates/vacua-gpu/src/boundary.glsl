// The triangulated boundary between active and inactive macrocells (paper A §4.2.2, Listing 1): the
// twin of `vacua_skip::BoundaryMesh`.
//
// Every face lies between a macrocell and the one below it along an axis, and belongs to the lattice
// point that both share, so that one pass over lattice points sees all three orientations. Faces are
// counted a group of points, the counts are summed, and each is written where it belongs: in Morton order
// of points, then of axes, so that faces next to each other follow each other. A group's points make a
// brick; the host has put bricks in that order. Deviation: Listing 1 takes places from one counter by an
// atomic a face, in an order that differs from run to run, and leaves out the guards for macrocells outside.

layout(local_size_x = 256) in;

// Lattice points of an invocation, one after the other, and of a workgroup.
const uint POINTS_EACH = 8;
const uvec3 BRICK = uvec3(16, 16, 8);

uint group_number() {
    return gl_WorkGroupID.x + 65535u * gl_WorkGroupID.y;
}

// Every third bit of a number, from the first.
uint thirds(uint number) {
    return number & 1u | number >> 2 & 2u | number >> 4 & 4u | number >> 6 & 8u;
}

// Where this group's brick begins. Those in its last row may reach beyond the lattice.
uvec3 brick_begin() {
    uvec3 n = (parameters.macrocells.xyz + BRICK) / BRICK;
    uint brick = parameters.bricks.word[group_number()];
    return uvec3(brick % n.x, brick / n.x % n.y, brick / (n.x * n.y)) * BRICK;
}

// A point of this invocation.
uvec3 point_of(uvec3 begin, uint number) {
    uint code = gl_LocalInvocationIndex * POINTS_EACH + number;
    return begin + uvec3(thirds(code), thirds(code >> 1), thirds(code >> 2));
}

// Whether a macrocell is active; those outside are not.
bool is_active(ivec3 at) {
    ivec3 n = ivec3(parameters.macrocells.xyz);
    if (any(lessThan(at, ivec3(0))) || any(greaterThanEqual(at, n))) return false;
    return is_active(uvec3(at));
}

// A bit for each axis across which there is a face at a point, and three further up one that says
// whether it looks up the axis.
uint faces_at(uvec3 point) {
    if (any(greaterThan(point, parameters.macrocells.xyz))) return 0;
    ivec3 at = ivec3(point);
    bool above = is_active(at);
    uint faces = 0;
    for (int axis = 0; axis < 3; ++axis) {
        ivec3 under = at;
        under[axis] -= 1;
        bool below = is_active(under);
        if (below != above) faces |= (below ? 9u : 1u) << axis;
    }
    return faces;
}
