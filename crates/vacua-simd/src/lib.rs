//! Sixteen lanes.
