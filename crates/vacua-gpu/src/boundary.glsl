// The triangulated boundary between active and inactive macrocells (paper A §4.2.2, Listing 1): the
// twin of `vacua_skip::BoundaryMesh`.
//
// Every face lies between a macrocell and the one below it along an axis, and belongs to the lattice
// point that both share, so that one pass over lattice points sees all three orientations. Faces are
// counted a group of points, the counts are summed, and each is written where it belongs: in order of
// points, then of axes. Deviation: Listing 1 takes places from one counter by an atomic a face, in an
// order that differs from run to run, and leaves out the guards for macrocells outside.

layout(local_size_x = 256) in;

// Lattice points of an invocation, one after the other, and of a workgroup.
const uint POINTS_EACH = 8;
const uint POINTS_A_GROUP = 256 * POINTS_EACH;

uint group_number() {
    return gl_WorkGroupID.x + 65535u * gl_WorkGroupID.y;
}

// The first point of an invocation.
uint first_point() {
    return group_number() * POINTS_A_GROUP + gl_LocalInvocationIndex * POINTS_EACH;
}

uvec3 point_of(uint index) {
    uvec3 n = parameters.macrocells.xyz + 1u;
    return uvec3(index % n.x, index / n.x % n.y, index / (n.x * n.y));
}

// Whether a macrocell is active; those outside are not.
bool is_active(ivec3 at) {
    ivec3 n = ivec3(parameters.macrocells.xyz);
    if (any(lessThan(at, ivec3(0))) || any(greaterThanEqual(at, n))) return false;
    return is_active(uvec3(at));
}

// A bit for each axis across which there is a face at a point, and three further up one that says
// whether it looks up the axis.
uint faces_at(uint index) {
    uvec3 n = parameters.macrocells.xyz + 1u;
    if (index >= n.x * n.y * n.z) return 0;
    ivec3 at = ivec3(point_of(index));
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
