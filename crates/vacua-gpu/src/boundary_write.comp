#version 460
#extension GL_GOOGLE_include_directive : require
// Writes the faces of the boundary, and where acceleration structures are built two triangles each, wound
// counter-clockwise as seen from the inactive side.
#extension GL_EXT_buffer_reference_uvec2 : require
#include "shared.glsl"
#include "lattice.glsl"
#include "boundary.glsl"
#include "scan.glsl"

void write_corner(uint index, int axis, vec3 at) {
    // From (axis, next, next but one) to (x, y, z).
    vec3 turned = axis == 0 ? at.xyz : axis == 1 ? at.zxy : at.yzx;
    for (int a = 0; a < 3; ++a) parameters.corners.number[3 * index + a] = turned[a];
}

void write_face(uint index, uvec3 point, int axis, bool looks_up) {
    int u = (axis + 1) % 3;
    int v = (axis + 2) % 3;
    parameters.faces.word[3 * index] = uint(axis) | (looks_up ? 4u : 0u) | point[axis] << 3;
    parameters.faces.word[3 * index + 1] = point[u];
    parameters.faces.word[3 * index + 2] = point[v];
    if (all(equal(uvec2(parameters.corners), uvec2(0)))) return;
    float wider = parameters.flange;
    float plane = macrocell_plane(axis, point[axis]);
    vec2 lo = vec2(macrocell_plane(u, point[u]), macrocell_plane(v, point[v])) - wider;
    vec2 hi = vec2(macrocell_plane(u, point[u] + 1), macrocell_plane(v, point[v] + 1)) + wider;
    vec3 a = vec3(plane, lo);
    vec3 b = vec3(plane, hi.x, lo.y);
    vec3 c = vec3(plane, hi);
    vec3 d = vec3(plane, lo.x, hi.y);
    uint first = 6 * index;
    write_corner(first, axis, looks_up ? a : b);
    write_corner(first + 1, axis, looks_up ? b : a);
    write_corner(first + 2, axis, c);
    write_corner(first + 3, axis, looks_up ? a : c);
    write_corner(first + 4, axis, looks_up ? c : a);
    write_corner(first + 5, axis, d);
}

void main() {
    if (group_number() >= parameters.num_face_groups) return;
    uint faces[POINTS_EACH];
    uint found = 0;
    uvec3 begin = brick_begin();
    for (uint i = 0; i < POINTS_EACH; ++i) {
        faces[i] = faces_at(point_of(begin, i));
        found += bitCount(faces[i] & 7u);
    }
    uint all;
    uint index = parameters.face_counts.word[group_number()] + sum_before(found, all);
    for (uint i = 0; i < POINTS_EACH; ++i) {
        if (faces[i] == 0) continue;
        uvec3 point = point_of(begin, i);
        for (int axis = 0; axis < 3; ++axis) {
            if ((faces[i] >> axis & 1u) == 0u) continue;
            write_face(index, point, axis, (faces[i] >> axis & 8u) != 0u);
            ++index;
        }
    }
}
