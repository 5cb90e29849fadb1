// Where values lie in the transfer table: the twin of `TransferTable::coordinate`. Sampling and
// classification use the same function, every step of which is monotone.

float table_coordinate(float value) {
    float lo = parameters.table_scale.x;
    precise float key;
    if (LOG_SCALE) {
        key = float(floatBitsToInt(max(value, lo)) - floatBitsToInt(lo));
    } else {
        key = value - lo;
    }
    precise float coordinate = key * parameters.table_scale.y;
    return clamp(coordinate, 0.0, float(TRANSFER_BINS));
}

uint table_bin(float value) {
    return min(uint(table_coordinate(value)), uint(TRANSFER_BINS - 1));
}
