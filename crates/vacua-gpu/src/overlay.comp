#version 460
#extension GL_GOOGLE_include_directive : require
// The boundary of the active macrocells drawn over a finished picture: the edges of its faces, those
// that are nearest to the camera. The twin of `vacua_render`'s overlay.
//
// A ray goes from macrocell to macrocell until one differs from the one before; what lies outside is
// inactive. How far the place is from the edges of that face is measured in pixels, by where the rays
// of the next pixels meet its plane.
#include "shared.glsl"
#include "lattice.glsl"
#include "ray.glsl"
#include "lanes.glsl"
#include "tile.glsl"

// Linear-light colour of the lines, their opacity, and half their width in pixels.
const vec3 LINE_COLOR = vec3(0.8, 0.12, 0.02);
const float LINE_OPACITY = 0.8;
const float LINE_HALF_WIDTH = 0.7;

struct Line {
    vec3 origin;
    vec3 direction;
};

// The line of sight through the middle of a pixel, from its anchor near the volume.
Line line_of(uvec2 pixel) {
    float x = float((double(pixel.x) + 0.5) * parameters.grid.y - 1.0);
    float y = float(1.0 - (double(pixel.y) + 0.5) * parameters.grid.z);
    return Line(
        parameters.anchor.xyz + x * parameters.anchor_x.xyz + y * parameters.anchor_y.xyz,
        parameters.direction.xyz + x * parameters.direction_x.xyz + y * parameters.direction_y.xyz
    );
}

bool is_active(ivec3 macrocell) {
    ivec3 n = ivec3(parameters.macrocells.xyz);
    bool is_inside = all(greaterThanEqual(macrocell, ivec3(0))) && all(lessThan(macrocell, n));
    return is_inside && is_active(uvec3(macrocell));
}

// The first face that a line meets in front of the camera: its axis, -1 if there is none, its
// plane's coordinate, and a macrocell beside it.
int first_face(Line line, out float plane, out ivec3 macrocell) {
    ivec3 n = ivec3(parameters.macrocells.xyz);
    // The camera, in lengths of the direction from the anchor.
    float camera = -float(parameters.grid.x) * parameters.box_lo.w;
    float enter = camera;
    float leave = LARGEST;
    int axis = -1;
    for (int a = 0; a < 3; ++a) {
        float lo = parameters.box_lo[a];
        float hi = parameters.box_hi[a];
        float step = line.direction[a];
        if (step == 0.0) {
            if (line.origin[a] < lo || line.origin[a] > hi) return -1;
            continue;
        }
        float p = ((step > 0.0 ? lo : hi) - line.origin[a]) / step;
        float q = ((step > 0.0 ? hi : lo) - line.origin[a]) / step;
        if (p >= enter) {
            enter = p;
            axis = a;
        }
        leave = min(leave, q);
    }
    if (enter > leave) return -1;
    vec3 at = clamp(line.origin + enter * line.direction, parameters.box_lo.xyz, parameters.box_hi.xyz);
    macrocell = ivec3(macrocell_of(at));
    if (axis >= 0) {
        bool is_upward = line.direction[axis] > 0.0;
        macrocell[axis] = is_upward ? 0 : n[axis] - 1;
        plane = is_upward ? parameters.box_lo[axis] : parameters.box_hi[axis];
    }
    // A camera in the volume sees the first change from where it is.
    bool before = axis < 0 && is_active(macrocell);
    for (int i = 0; i <= n.x + n.y + n.z; ++i) {
        bool is_outside = any(lessThan(macrocell, ivec3(0))) || any(greaterThanEqual(macrocell, n));
        if (is_active(macrocell) != before) {
            if (is_outside) macrocell[axis] += line.direction[axis] > 0.0 ? -1 : 1;
            return axis;
        }
        if (is_outside) return -1;
        float nearest = LARGEST;
        for (int a = 0; a < 3; ++a) {
            if (line.direction[a] == 0.0) continue;
            int next = macrocell[a] + (line.direction[a] > 0.0 ? 1 : 0);
            float coordinate = macrocell_plane(a, uint(next));
            float t = (coordinate - line.origin[a]) / line.direction[a];
            if (t < nearest) {
                nearest = t;
                axis = a;
                plane = coordinate;
            }
        }
        macrocell[axis] += line.direction[axis] > 0.0 ? 1 : -1;
    }
    return -1;
}

vec3 on_plane(Line line, int axis, float plane) {
    float t = (plane - line.origin[axis]) / line.direction[axis];
    return line.origin + t * line.direction;
}

void main() {
    uvec2 own = own_pixel();
    uvec2 pixel = uvec2(own.x, global_row(own.y));
    if (pixel.x >= parameters.picture.x || pixel.y >= parameters.picture.y) return;
    Line line = line_of(pixel);
    float plane;
    ivec3 macrocell;
    int axis = first_face(line, plane, macrocell);
    if (axis < 0) return;
    vec3 hit = on_plane(line, axis, plane);
    vec3 right = on_plane(line_of(pixel + uvec2(1, 0)), axis, plane);
    vec3 below = on_plane(line_of(pixel + uvec2(0, 1)), axis, plane);
    float nearest = LARGEST;
    for (int side = 1; side < 3; ++side) {
        int a = (axis + side) % 3;
        float per_pixel = length(vec2(right[a] - hit[a], below[a] - hit[a]));
        for (int i = 0; i < 2; ++i) {
            float apart = abs(hit[a] - macrocell_plane(a, uint(macrocell[a] + i)));
            nearest = min(nearest, apart / per_pixel);
        }
    }
    float cover = LINE_OPACITY * clamp(LINE_HALF_WIDTH + 0.5 - nearest, 0.0, 1.0);
    uint index = pixel.x + parameters.picture.x * own.y;
    push.rgba.quad[index] = mix(push.rgba.quad[index], vec4(LINE_COLOR, 1.0), cover);
}
