// What a ray gathers, and how a sample is added to it. The including stage has the transfer table:
// `table_ends` are both ends of a bin's extinction, `table_entry` is an entry, all as halves.

// Extinction, as a part of the largest, a fraction of the way through a bin.
float extinction_at(uint bin, float t) {
    vec2 ends = unpackHalf2x16(table_ends(bin));
    precise float mixed = fma(t, ends.y - ends.x, ends.x);
    return mixed;
}

// Colour a fraction of the way through a bin.
vec3 color_at(uint bin, float t) {
    uvec2 lo = table_entry(bin);
    uvec2 hi = table_entry(bin + 1);
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

Pixel empty_pixel() {
    return Pixel(vec3(0.0), 1.0, -1.0, parameters.table_scale.w, 0);
}

// Where a value is in the transfer table, and its extinction as a part of the largest.
struct Seen {
    uint bin;
    float t;
    float extinction;
};

// What is seen of the value of sample `k`: nothing is left to be composited where there is no extinction.
Seen see(inout Pixel pixel, float k, float value) {
    if (MAXIMUM) {
        if (value > pixel.best) {
            pixel.best = value;
            pixel.depth_sample = k;
        }
        return Seen(0, 0.0, 0.0);
    }
    float coordinate = table_coordinate(value);
    uint bin = min(uint(coordinate), uint(TRANSFER_BINS - 1));
    float t = coordinate - float(bin);
    return Seen(bin, t, extinction_at(bin, t));
}

// Composites sample `k` over a length; `light` is a factor on its colour and white that is added to it.
void composite(inout Pixel pixel, float k, Seen seen, float optical_length, vec2 light) {
    vec3 color = color_at(seen.bin, seen.t);
    if (SHADED) {
        precise vec3 lit = fma(color, vec3(light.x), vec3(light.y));
        color = lit;
    }
    precise float depth = seen.extinction * optical_length;
    precise float behind = pixel.transmittance * exp2(-depth);
    precise float weight = pixel.transmittance - behind;
    precise vec3 sum = fma(vec3(weight), color, pixel.color);
    pixel.color = sum;
    pixel.transmittance = behind;
    if (behind <= 0.5 && pixel.depth_sample < 0.0) pixel.depth_sample = k;
}

// Writes a pixel, or adds it to the frames before; `row` is one of this device's own.
void store(Pixel pixel, uvec2 at, uint row, float dt, float t_start) {
    vec4 rgba = vec4(pixel.color, 1.0 - pixel.transmittance);
    bool has_depth = pixel.depth_sample >= 0.0;
    if (MAXIMUM) {
        float coordinate = table_coordinate(pixel.best);
        uint bin = min(uint(coordinate), uint(TRANSFER_BINS - 1));
        vec3 color = color_at(bin, coordinate - float(bin));
        rgba = has_depth ? vec4(color, 1.0) : vec4(0.0);
    }
    uint index = at.x + parameters.picture.x * row;
    uint samples = pixel.samples;
    if (push.frame > 0) {
        rgba += push.rgba.quad[index];
        samples += push.samples.word[index];
    } else {
        float t = fma(pixel.depth_sample, dt, t_start);
        push.depth.number[index] = has_depth ? t : uintBitsToFloat(0x7f800000u);
    }
    if (push.weight > 0.0) rgba *= push.weight;
    push.rgba.quad[index] = rgba;
    push.samples.word[index] = samples;
}
