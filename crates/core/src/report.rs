//! What was recoverable: findings with place, fact and consequence.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Where something happened; parts that do not apply are `None`.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Place {
    /// View name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub view: Option<String>,
    /// Frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame: Option<usize>,
    /// Strand.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub strand: Option<usize>,
}

impl Place {
    /// A frame of all views.
    pub fn frame(frame: usize) -> Self {
        Self { frame: Some(frame), ..Self::default() }
    }

    /// A frame of one view.
    pub fn view_frame(view: &str, frame: usize) -> Self {
        Self { view: Some(view.to_owned()), frame: Some(frame), strand: None }
    }

    /// A strand over the whole take.
    pub fn strand(strand: usize) -> Self {
        Self { strand: Some(strand), ..Self::default() }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parts = [
            self.view.as_ref().map(|view| format!("view {view}")),
            self.frame.map(|frame| format!("frame {frame}")),
            self.strand.map(|strand| format!("strand {strand}")),
        ];
        let text: Vec<String> = parts.into_iter().flatten().collect();
        f.write_str(if text.is_empty() { "take".to_owned() } else { text.join(", ") }.as_str())
    }
}

/// One thing that went wrong and was survived.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// Where.
    pub place: Place,
    /// What is the case ("used 4 of 9 markers, need 5").
    pub fact: String,
    /// What follows ("pose interpolated").
    pub consequence: String,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}; {}", self.place, self.fact, self.consequence)
    }
}

/// The findings of one work item, in the order they were met.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// The findings.
    pub findings: Vec<Finding>,
}

impl Report {
    /// Adds a finding.
    pub fn warn(&mut self, place: Place, fact: impl Into<String>, consequence: impl Into<String>) {
        self.findings.push(Finding { place, fact: fact.into(), consequence: consequence.into() });
    }
}
