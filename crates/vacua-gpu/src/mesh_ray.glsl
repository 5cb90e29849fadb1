// A ray through a packed mesh: blocks of samples are located, then composited one by one in order,
// front to back. A sample without extinction multiplies by exactly 1 and adds exactly 0, so that
// leaving it out changes no bit. Whether a ray ends is asked at the ends of blocks only.
//
// Who includes this has `TOGETHER`, `first_wanted`, `find_all` and `find`.

// The transfer table where it lies: a mesh's samples cost much more than looking them up.
uvec2 table_entry(uint index) {
    return push.table.entry[index];
}

uint table_ends(uint bin) {
    return push.table.entry[bin].y >> 16 | push.table.entry[bin + 1].y & 0xffff0000u;
}

#include "composite.glsl"

// The ray, and the block of it that is being sampled.
Ray ray;
vec4 corner;
uint block_first;
uint block_stride;

// Where a sample of a ray is, in the mesh's own space.
vec3 place_at(vec3 start, vec3 step, float k) {
    precise vec3 at = fma(vec3(k), step, start);
    precise vec3 place = fma(at, vec3(corner.w), corner.xyz);
    return place;
}

vec3 place_of(uint i) {
    return place_at(ray.start, ray.step, float(block_first + i * block_stride));
}

// What was found at a sample.
struct Found {
    Cell cell;
    // The value and whether there is one, if it is known already: of a cell other than a tetrahedron that
    // was searched for together.
    bool is_valid;
    float value;
};

// Adds sample `k` of a cell.
void add(inout Pixel pixel, Mesh mesh, float k, vec3 place, float optical_length, Found at) {
    Submesh part = mesh.submeshes.submesh[at.cell.number];
    float value = at.value;
    bool is_valid = at.is_valid;
    if (!(TOGETHER && HAS_OTHERS && (!HAS_TETS || at.cell.is_other))) {
        // Not another cell, where values of these are known.
        Cell cell = at.cell;
        if (TOGETHER) cell.is_other = false;
        is_valid = value_in_cell(mesh, part, cell, place, value);
    }
    if (!is_valid) return;
    Seen seen = see(pixel, k, value);
    if (seen.extinction <= 0.0) return;
    vec2 light = vec2(1.0, 0.0);
    if (SHADED) {
        precise vec3 gradient = gradient_in_cell(mesh, part, at.cell, place) * corner.w;
        light = shade(gradient, ray.direction);
    }
    composite(pixel, k, seen, optical_length, light);
}

// Smallest cell in the box between two cubes of ray space, from below: boxes grow to at most two
// nodes a side of a hierarchy. Twin of `vacua_render`'s minima.
float smallest(Mesh mesh, vec3 p, vec3 q) {
    ivec3 lo = ivec3(max(min(p, q), vec3(0.0)));
    ivec3 hi = ivec3(max(max(p, q), vec3(0.0)));
    ivec3 n = ivec3(mesh.minima_x, mesh.minima_y, mesh.minima_z);
    uint first = 0;
    while (any(greaterThan(hi - lo, ivec3(1)))) {
        lo >>= 1;
        hi >>= 1;
        first += uint(n.x * n.y * n.z);
        n = (n + 1) >> 1;
    }
    float least = LARGEST;
    for (int z = lo.z; z <= hi.z; ++z) {
        for (int y = lo.y; y <= hi.y; ++y) {
            for (int x = lo.x; x <= hi.x; ++x) {
                least = min(least, mesh.minima.number[first + uint(x + n.x * (y + n.y * z))]);
            }
        }
    }
    return least;
}

// Level of the dyadic block that holds sample k: twin of `vacua_render`'s partition.
uint level_of(Mesh mesh, vec3 rates, uint k) {
    float finest_sq = dot_of(rates, rates);
    for (uint level = MAX_LEVEL; level > 0; --level) {
        uint first = k & ~((BLOCK << level) - 1);
        uint last = first + (BLOCK << level) - 1;
        float size =
            smallest(mesh, cell_of(position(ray, float(first))), cell_of(position(ray, float(last))));
        vec3 rate = rates / size;
        float stride = float(1u << level);
        if (dot_of(rate, rate) * stride * stride <= finest_sq) return level;
    }
    return 0;
}

// The first block that any ray wants that goes in step with this one.
uint first_wanted(uint wanted);
// Finds the cells of a block's samples, or leaves that to `find`.
void find_all(Mesh mesh, Segment segment);
// The cell of a sample of the block; false if there is none.
bool find(Mesh mesh, uint i, vec3 place, out Found at);

// Marches the ray, in step with others if `first_wanted` has it so: all of them sample the same block,
// the first that any of them needs, or wait.
void march(inout Pixel pixel, Mesh mesh) {
    // Compiling the search for other cells than tetrahedra takes seconds: whether rays skip is asked at run time
    // there, which takes none of it. That for tetrahedra is slower by 1 to 3 % if it asks.
    bool is_skipping = HAS_OTHERS ? any(notEqual(uvec2(push.skip), uvec2(0))) : SKIPPING;
    vec3 inverse_step = 1.0 / ray.step;
    float termination = parameters.box_hi.w;
    float optical_length = ray.dt * parameters.table_scale.z * 1.44269504;
    vec3 rates = ray.step / vec3(
        parameters.anchor.w, parameters.anchor_x.w, parameters.anchor_y.w
    );
    const uint NEVER = 0xffffffffu;
    uint k = ray.begin;
    uint stop = is_skipping ? k : ray.end;
    uint last_block = k / BLOCK;
    while (true) {
        while (is_skipping && k >= stop && k < ray.end) {
            uint next;
            uint apart = look_ahead(ray, inverse_step, k, next);
            stop = min(next, ray.end);
            if (apart > 0) k = stop;
        }
        // Whether a ray ends is asked when it comes to another block.
        bool has_ended = !MAXIMUM && pixel.transmittance < termination && k / BLOCK != last_block;
        if (has_ended) k = ray.end;
        uint wanted = k < ray.end ? k / BLOCK : NEVER;
        uint block = first_wanted(wanted);
        if (block == NEVER) break;
        bool is_turn = wanted == block;
        Segment segment = Segment(vec3(0.0), vec3(0.0), 0, 0.0, 0);
        if (is_turn) {
            last_block = block;
            uint level = VARYING ? level_of(mesh, rates, k) : 0;
            block_stride = 1u << level;
            block_first = k & ~((BLOCK << level) - 1);
            // From the first sample of it at or after k.
            uint begin = (k - block_first + block_stride - 1) >> level;
            uint limit = min(block_first + (BLOCK << level), ray.end);
            uint end = (limit - block_first + block_stride - 1) >> level;
            if (begin < end) {
                segment.mask = (1u << end) - (1u << begin);
                segment.begin = begin;
                segment.steps = float(end - 1 - begin);
                segment.first = place_of(begin);
                segment.last = place_of(end - 1);
                pixel.samples += end - begin;
            }
            k = block_first + (BLOCK << level);
            if (VARYING) stop = is_skipping ? k : ray.end;
        }
        find_all(mesh, segment);
        uint left = segment.mask;
        while (left != 0) {
            uint i = uint(findLSB(left));
            left &= left - 1;
            vec3 place = place_of(i);
            Found at;
            if (!find(mesh, i, place, at)) continue;
            float sample_number = float(block_first + i * block_stride);
            add(pixel, mesh, sample_number, place, optical_length * float(block_stride), at);
        }
    }
}

// Makes a pixel, by number among those of this device.
void make_pixel(Mesh mesh, uvec2 own) {
    uvec2 at = uvec2(own.x, global_row(own.y));
    bool is_pixel = at.x < parameters.picture.x && at.y < parameters.picture.y;
    corner = mesh.corner;
    Pixel pixel = empty_pixel();
    ray = ray_of(at);
    if (!is_pixel) ray.end = 0;
    march(pixel, mesh);
    if (is_pixel) store(pixel, at, own.y, ray.dt, ray.t_start);
}
