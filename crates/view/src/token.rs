//! The secret that a request must carry: other users of the machine can reach the port, and must not see the footage.

use std::{fmt, str::FromStr};

/// 128 random bits, written as 32 hexadecimal digits.
#[derive(Clone, PartialEq, Eq)]
pub struct Token([u8; 32]);

impl Token {
    /// A new one from the operating system's random numbers.
    ///
    /// # Errors
    /// The system has none.
    pub fn random() -> std::io::Result<Self> {
        let mut bits = [0u8; 16];
        getrandom::fill(&mut bits).map_err(|error| std::io::Error::other(error.to_string()))?;
        let mut digits = [0; 32];
        for (pair, byte) in digits.chunks_exact_mut(2).zip(bits) {
            pair.copy_from_slice(&[digit(byte >> 4), digit(byte & 15)]);
        }
        Ok(Self(digits))
    }

    /// Whether a request's token is this one. Takes the same time wherever they differ, so that it cannot be guessed digit by
    /// digit.
    pub fn matches(&self, given: &str) -> bool {
        let given = given.as_bytes();
        let differing = self.0.iter().zip(given).fold(0, |all, (a, b)| all | (a ^ b));
        given.len() == self.0.len() && differing == 0
    }
}

fn digit(nibble: u8) -> u8 {
    b"0123456789abcdef"[usize::from(nibble)]
}

impl FromStr for Token {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let digits: [u8; 32] = text.as_bytes().try_into().map_err(|_| "a token has 32 digits")?;
        digits.iter().all(u8::is_ascii_hexdigit).then_some(Self(digits)).ok_or("a token is hexadecimal")
    }
}

impl fmt::Display for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|digit| write!(f, "{}", char::from(*digit)))
    }
}

impl fmt::Debug for Token {
    /// The secret stays out of logs.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token(…)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_matches_itself_alone() {
        let (one, two) = (Token::random().unwrap(), Token::random().unwrap());
        let text = one.to_string();
        assert!(text.len() == 32 && one.matches(&text) && one != two && !one.matches(&two.to_string()));
        for wrong in ["", &text[..31], &format!("{text}0"), &text.to_uppercase().replace(char::is_numeric, "A")] {
            assert!(!one.matches(wrong), "{wrong}");
        }
        assert!(text.parse::<Token>().unwrap() == one && "0g".repeat(16).parse::<Token>().is_err());
        assert!(!format!("{one:?}").contains(&text));
    }
}
