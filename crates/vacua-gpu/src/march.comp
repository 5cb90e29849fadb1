#version 460
#extension GL_GOOGLE_include_directive : require
// One ray a pixel: walks the distance map, samples what is active, composites front to back.
//
// Samples are composited one by one in order; a sample without extinction multiplies by exactly 1
// and adds exactly 0, so that leaving it out changes no bit. Whether a ray ends is asked at the ends
// of blocks only, as the contract has it.
#extension GL_KHR_shader_subgroup_arithmetic : require
#include "shared.glsl"
#include "lattice.glsl"
#include "table.glsl"
#include "volume.glsl"
#include "ray.glsl"

layout(local_size_x = 256) in;

// Transfer table as halves: red and green, blue and extinction; and both ends of each bin's
// extinction, which is all that most samples ask for. A filtered image of colours in place of the
// first was 9 to 16 % slower on an H100, whose texture units are what bounds this shader.
shared uvec2 colors[TRANSFER_BINS + 1];
shared uint extinctions[TRANSFER_BINS];

// Samples that are fetched before the first of them is evaluated.
const uint BATCH = 4;

struct Sample {
    vec3 cell;
    vec3 fraction;
    // Corners below and above along z, as `gather` has them.
    vec4 front;
    vec4 back;
    float value;
};

float lerp(float t, float a, float b) {
    precise float mixed = fma(t, b - a, a);
    return mixed;
}

// Corners interpolated along x, the lower row first.
vec2 along_x(float t, vec4 corners) {
    return vec2(lerp(t, corners.w, corners.z), lerp(t, corners.x, corners.y));
}

// Fetches what a sample needs; what becomes of it is computed later, so that several fetches are
// under way at once.
Sample fetch_at(vec3 at) {
    Sample s;
    s.cell = cell_of(at);
    if (CELL_DATA) {
        s.value = fetch(s.cell);
    } else {
        s.fraction = fraction_of(at, s.cell);
        int slab = slab_of(s.cell.z);
        vec2 corner = s.cell.xy + 1.0;
        s.front = gather(slab, corner, s.cell.z);
        s.back = gather(slab, corner, s.cell.z + 1.0);
    }
    return s;
}

// The value of what was fetched, and whether there is one.
bool evaluate(inout Sample s) {
    if (!CELL_DATA) {
        vec2 front = along_x(s.fraction.x, s.front);
        vec2 back = along_x(s.fraction.x, s.back);
        s.value = lerp(
            s.fraction.z,
            lerp(s.fraction.y, front.x, front.y),
            lerp(s.fraction.y, back.x, back.y)
        );
    }
    s.value = value_of(s.value);
    return (!CHECK_FINITE || is_finite(s.value)) && !is_blanked(s.cell);
}

// Central differences at the second and third of four values, interpolated between them.
float slope(vec4 line, float t, vec2 inverse_spans) {
    return lerp(t, (line.z - line.x) * inverse_spans.x, (line.w - line.y) * inverse_spans.y);
}

// One over the distances between the points before a cell's ends and after them.
vec2 inverse_spans(int axis, float cell) {
    uint here = uint(cell);
    uint before = here == 0 ? 0 : here - 1;
    uint after = min(here + 2, parameters.cells[axis]);
    return vec2(
        1.0 / (plane_at(axis, here + 1) - plane_at(axis, before)),
        1.0 / (plane_at(axis, after) - plane_at(axis, here))
    );
}

// The gradient in ray space: central differences at the points, one-sided at the ends.
vec3 gradient(Sample s) {
    if (CELL_DATA) return vec3(0.0);
    int slab = slab_of(s.cell.z);
    vec2 corner = s.cell.xy + 1.0;
    vec3 f = s.fraction;
    vec2 spans_x = inverse_spans(0, s.cell.x);
    vec2 spans_y = inverse_spans(1, s.cell.y);
    vec2 spans_z = inverse_spans(2, s.cell.z);
    vec2 x_slopes[2];
    float y_slopes[2];
    vec2 here[2];
    for (int i = 0; i < 2; ++i) {
        float layer = s.cell.z + float(i);
        vec4 middle = i == 0 ? s.front : s.back;
        vec4 left = gather(slab, corner - vec2(1.0, 0.0), layer);
        vec4 right = gather(slab, corner + vec2(1.0, 0.0), layer);
        vec4 below = gather(slab, corner - vec2(0.0, 1.0), layer);
        vec4 above = gather(slab, corner + vec2(0.0, 1.0), layer);
        here[i] = along_x(f.x, middle);
        x_slopes[i] = vec2(
            slope(vec4(left.w, middle.w, middle.z, right.z), f.x, spans_x),
            slope(vec4(left.x, middle.x, middle.y, right.y), f.x, spans_x)
        );
        float before = lerp(f.x, below.w, below.z);
        float after = lerp(f.x, above.x, above.y);
        y_slopes[i] = slope(vec4(before, here[i], after), f.y, spans_y);
    }
    float layer_before = max(s.cell.z - 1.0, 0.0);
    float layer_after = min(s.cell.z + 2.0, float(parameters.cells.z));
    vec2 before = along_x(f.x, gather(slab, corner, layer_before));
    vec2 after = along_x(f.x, gather(slab, corner, layer_after));
    vec2 z_slopes = vec2(
        slope(vec4(before.x, here[0].x, here[1].x, after.x), f.z, spans_z),
        slope(vec4(before.y, here[0].y, here[1].y, after.y), f.z, spans_z)
    );
    return vec3(
        lerp(f.z, lerp(f.y, x_slopes[0].x, x_slopes[0].y), lerp(f.y, x_slopes[1].x, x_slopes[1].y)),
        lerp(f.z, y_slopes[0], y_slopes[1]),
        lerp(f.y, z_slopes.x, z_slopes.y)
    ) * parameters.texel.z;
}

// Factor on the colour and white added to it: lit from the camera, Blinn–Phong. Twin of
// `vacua_render`'s light.
vec2 shade(vec3 g, vec3 direction) {
    vec3 m = parameters.metric_squares.xyz;
    vec3 n = parameters.metric_products.xyz;
    float length_sq = g.x * (g.x * m.x + g.y * n.x + g.z * n.y)
        + g.y * (g.y * m.y + g.z * n.z) + g.z * g.z * m.z;
    if (!(length_sq > 1.17549435e-38)) return vec2(1.0, 0.0);
    float cosine = min(abs(dot(g, direction)) / sqrt(length_sq), 1.0);
    float shine = cosine;
    for (int i = 0; i < 5; ++i) shine *= shine;
    return vec2(0.35 + 0.65 * cosine, 0.25 * shine);
}

// Extinction, as a part of the largest, a fraction of the way through a bin.
float extinction_at(uint bin, float t) {
    vec2 ends = unpackHalf2x16(extinctions[bin]);
    precise float mixed = fma(t, ends.y - ends.x, ends.x);
    return mixed;
}

// Colour a fraction of the way through a bin.
vec3 color_at(uint bin, float t) {
    uvec2 lo = colors[bin];
    uvec2 hi = colors[bin + 1];
    vec3 a = vec3(unpackHalf2x16(lo.x), unpackHalf2x16(lo.y).x);
    vec3 b = vec3(unpackHalf2x16(hi.x), unpackHalf2x16(hi.y).x);
    precise vec3 mixed = fma(vec3(t), b - a, a);
    return mixed;
}

// What one ray has gathered.
struct Pixel {
    vec3 color;
    float transmittance;
    float depth_sample;
    float best;
    uint samples;
};

// Adds sample `k`, which was fetched.
void add(inout Pixel pixel, Ray ray, float k, float optical_length, Sample s) {
    if (!evaluate(s)) return;
    if (MAXIMUM) {
        if (s.value > pixel.best) {
            pixel.best = s.value;
            pixel.depth_sample = k;
        }
        return;
    }
    float coordinate = table_coordinate(s.value);
    uint bin = min(uint(coordinate), uint(TRANSFER_BINS - 1));
    float t = coordinate - float(bin);
    float extinction = extinction_at(bin, t);
    if (extinction <= 0.0) return;
    vec3 color = color_at(bin, t);
    if (SHADED) {
        vec2 lit = shade(gradient(s), ray.direction);
        color = color * lit.x + lit.y;
    }
    precise float depth = extinction * optical_length;
    precise float behind = pixel.transmittance * exp2(-depth);
    precise float weight = pixel.transmittance - behind;
    precise vec3 sum = fma(vec3(weight), color, pixel.color);
    pixel.color = sum;
    pixel.transmittance = behind;
    if (behind <= 0.5 && pixel.depth_sample < 0.0) pixel.depth_sample = k;
}

// Distance of a sample's macrocell to the nearest active one, 0 if it is active itself; and the
// first sample that may lie outside the box of macrocells that are known to be alike.
uint look_ahead(Ray ray, vec3 inverse_step, uint k, out uint next) {
    // ⌊c / K⌋ exactly: no multiple of 1/K is nearer to (c + ½)/K than ½/K.
    vec3 at = trunc((cell_of(position(ray, float(k))) + 0.5) * parameters.last_cell.w);
    uint index = macrocell_index(ivec3(at));
    uint apart = push.skip.word[index >> 2] >> (8 * (index & 3u)) & 255u;
    float side = float(parameters.macrocells.w);
    float reach = float(max(apart, 1u)) * side;
    bvec3 upward = greaterThanEqual(ray.step, vec3(0.0));
    vec3 plane = at * side + mix(vec3(side - reach), vec3(reach), upward);
    if (RECTILINEAR) {
        for (int a = 0; a < 3; ++a) {
            uint cell = uint(clamp(plane[a], 0.0, float(parameters.cells[a])));
            plane[a] = plane_at(a, cell);
        }
    }
    // A computed coordinate may reach a plane a few roundings before the line does, more so where
    // `fma` rounds twice, as it may.
    float slack = parameters.length_sq.w;
    vec3 ahead = ray.start + mix(vec3(-slack), vec3(slack), upward);
    precise vec3 crossing = (plane - ahead) * inverse_step;
    crossing = mix(crossing, vec3(LARGEST), equal(ray.step, vec3(0.0)));
    float leave = min(crossing.x, min(crossing.y, crossing.z));
    // Rounding down by more than the arithmetic can be off never passes a sample.
    float bound = ceil(leave * (1.0 - 2e-6));
    next = max(k + 1, uint(clamp(bound, 0.0, float(MAX_SAMPLES))));
    return apart;
}

// Smallest cell between two, both included, along an axis, in units of the smallest of all.
float smallest(int axis, float p, float q) {
    uint cells = parameters.cells[axis];
    uint a = uint(min(p, q));
    uint b = uint(max(p, q));
    uint level = uint(findMSB(b - a + 1));
    uint minima = parameters.axis_offset[axis] + (cells + 1) + 4 * cells
        + level * (cells + 1) - ((1u << level) - 1);
    return min(push.planes.number[minima + a], push.planes.number[minima + b + 1 - (1u << level)]);
}

// Level of the dyadic block that holds sample k: twin of `vacua_render`'s partition.
uint level_of(Ray ray, vec3 rates, uint k) {
    float finest_sq = dot(rates, rates);
    for (uint level = MAX_LEVEL; level > 0; --level) {
        uint first = k & ~((BLOCK << level) - 1);
        uint last = first + (BLOCK << level) - 1;
        vec3 p = cell_of(position(ray, float(first)));
        vec3 q = cell_of(position(ray, float(last)));
        float rate_sq = 0.0;
        for (int a = 0; a < 3; ++a) {
            float rate = rates[a] / smallest(a, p[a], q[a]);
            rate_sq += rate * rate;
        }
        float stride = float(1u << level);
        if (rate_sq * stride * stride <= finest_sq) return level;
    }
    return 0;
}

// Marches one ray, in step with the others of its subgroup: all of them evaluate the same block of
// samples, the first that any of them needs, or wait. So their samples stay neighbours, and no ray
// walks while others sample.
void march(inout Pixel pixel, Ray ray) {
    vec3 inverse_step = 1.0 / ray.step;
    float termination = parameters.box_hi.w;
    float optical_length = ray.dt * parameters.table_scale.z * 1.44269504;
    vec3 rates = vec3(0.0);
    if (RECTILINEAR) {
        rates = ray.step / vec3(
            parameters.anchor.w, parameters.anchor_x.w, parameters.anchor_y.w
        );
    }
    const uint NEVER = 0xffffffffu;
    uint k = ray.begin;
    // Samples from k to here are in one active macrocell; what follows in its last block is
    // evaluated too, so that no block is visited twice.
    uint stop = SKIPPING ? k : ray.end;
    uint last_block = k / BLOCK;
    while (true) {
        while (SKIPPING && k >= stop && k < ray.end) {
            uint next;
            uint apart = look_ahead(ray, inverse_step, k, next);
            stop = min(next, ray.end);
            if (apart > 0) k = stop;
        }
        // Whether a ray ends is asked when it comes to another block.
        bool has_ended = !MAXIMUM && pixel.transmittance < termination && k / BLOCK != last_block;
        if (has_ended) k = ray.end;
        uint wanted = k < ray.end ? k / BLOCK : NEVER;
        uint block = subgroupMin(wanted);
        if (block == NEVER) break;
        if (wanted == block) {
            last_block = block;
            if (RECTILINEAR) {
                // A whole block at a time, from its first sample at or after k.
                uint level = level_of(ray, rates, k);
                uint stride = 1u << level;
                uint block_end = (k & ~((BLOCK << level) - 1)) + (BLOCK << level);
                uint limit = min(block_end, ray.end);
                uint i = (k + stride - 1) & ~(stride - 1);
                for (; i < limit; i += stride) {
                    Sample s = fetch_at(position(ray, float(i)));
                    add(pixel, ray, float(i), optical_length * float(stride), s);
                    ++pixel.samples;
                }
                k = block_end;
                stop = SKIPPING ? k : ray.end;
            } else {
                uint first = block * BLOCK;
                uint limit = min(first + BLOCK, ray.end);
                pixel.samples += limit - k;
                for (uint i = first; i < limit; i += BATCH) {
                    if (i + BATCH <= k) continue;
                    Sample fetched[BATCH];
                    for (uint j = 0; j < BATCH; ++j) {
                        fetched[j] = fetch_at(position(ray, float(i + j)));
                    }
                    for (uint j = 0; j < BATCH; ++j) {
                        if (i + j < k || i + j >= limit) continue;
                        add(pixel, ray, float(i + j), optical_length, fetched[j]);
                    }
                }
                k = limit;
            }
        }
    }
}

void main() {
    for (uint i = gl_LocalInvocationIndex; i <= TRANSFER_BINS; i += 256) {
        uvec2 entry = push.table.entry[i];
        colors[i] = entry;
        if (i < TRANSFER_BINS) {
            uvec2 next = push.table.entry[i + 1];
            extinctions[i] = entry.y >> 16 | next.y & 0xffff0000u;
        }
    }
    barrier();
    // Subgroups of 32 see 8 × 4 pixels.
    uint lane = gl_LocalInvocationIndex & 31u;
    uint group = gl_LocalInvocationIndex >> 5;
    uvec2 at = gl_WorkGroupID.xy * 16u
        + uvec2((group & 1u) * 8u + (lane & 7u), (group >> 1) * 4u + (lane >> 3));
    if (at.x >= parameters.picture.x || at.y >= parameters.picture.y) return;
    Pixel pixel;
    pixel.color = vec3(0.0);
    pixel.transmittance = 1.0;
    pixel.depth_sample = -1.0;
    pixel.best = parameters.table_scale.w;
    pixel.samples = 0;
    Ray ray = ray_of(at);
    march(pixel, ray);
    vec4 rgba = vec4(pixel.color, 1.0 - pixel.transmittance);
    bool has_depth = pixel.depth_sample >= 0.0;
    if (MAXIMUM) {
        float coordinate = table_coordinate(pixel.best);
        uint bin = min(uint(coordinate), uint(TRANSFER_BINS - 1));
        vec3 color = color_at(bin, coordinate - float(bin));
        rgba = has_depth ? vec4(color, 1.0) : vec4(0.0);
    }
    uint index = at.x + parameters.picture.x * at.y;
    uint samples = pixel.samples;
    if (push.frame > 0) {
        rgba += push.rgba.quad[index];
        samples += push.samples.word[index];
    } else {
        float t = fma(pixel.depth_sample, ray.dt, ray.t_start);
        push.depth.number[index] = has_depth ? t : uintBitsToFloat(0x7f800000u);
    }
    if (push.weight > 0.0) rgba *= push.weight;
    push.rgba.quad[index] = rgba;
    push.samples.word[index] = samples;
}
