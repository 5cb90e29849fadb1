//! Stand-ins for data sets that papers and benchmarks use and that cannot be shipped. Shapes and
//! transfer functions are tuned so that the share of active macrocells at K = 8, 16 and 32 comes
//! near Table 1 of paper A (Wald, Zellmann and Morrical 2021).

mod blobs;
mod dns;
mod flower;
mod heptane;
mod llnl;
mod looks;

pub(crate) use blobs::Blobs;
pub(crate) use dns::Dns;
pub(crate) use flower::Flower;
pub(crate) use heptane::Heptane;
pub(crate) use llnl::Llnl;
pub(crate) use looks::looks;
