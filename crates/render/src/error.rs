//! Why there is no picture.

/// What is wrong with what was to be rendered.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RenderError {
    /// No strand has two points.
    #[error("there is no strand to render")]
    NoHair,
    /// A point is no number.
    #[error("strand {strand}, point {point}: the position is not finite")]
    NotFinite {
        /// Number of the strand in the hair.
        strand: usize,
        /// Point of the strand, root first.
        point: usize,
    },
    /// The picture would be empty or too large.
    #[error("a picture of {width}×{height} pixels cannot be rendered")]
    Size {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// The hairs have more points than are held at once.
    #[error("the hair would have {points} points, at most {} are rendered", crate::MAX_POINTS)]
    TooMany {
        /// Points of all hairs.
        points: usize,
    },
    /// A setting is out of its range.
    #[error("{name} is {value}, not in {range}")]
    Setting {
        /// Name of the setting.
        name: &'static str,
        /// What it is.
        value: String,
        /// What it may be.
        range: String,
    },
}

impl RenderError {
    /// What to do about it.
    pub fn hint(&self) -> String {
        match self {
            Self::NoHair => "give a stage or a frame that has strands".into(),
            Self::NotFinite { .. } => "leave missing points out of the strands".into(),
            Self::Size { .. } => format!("each side may have 1 to {} pixels", crate::MAX_SIDE),
            Self::TooMany { .. } => "give a lower density, or a smaller picture".into(),
            Self::Setting { range, .. } => format!("give a value in {range}"),
        }
    }
}
