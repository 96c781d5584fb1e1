//! Filters, orientation maps, robust optical flow and mattes.
