//! One file per format: calibrations, images, video, strands, USD.
