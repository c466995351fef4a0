//! Who may command: whoever knows the token in the page's address.
//!
//! Other users of this computer can reach the page too, and may watch. The token stands behind the `#` of the address, which browsers
//! send to nobody. What opens a browser shows the address to all users in the list of processes, so that it gets a ticket in place of
//! the token: the first page that shows the ticket is given the token, nobody after it.

use std::io;
use std::sync::{Mutex, PoisonError};

/// The token of a running server, and a ticket for it.
pub(super) struct Keys {
    token: String,
    ticket: Mutex<Option<String>>,
}

/// 128 random bits as hexadecimal digits.
fn secret() -> io::Result<String> {
    let mut bits = [0_u8; 16];
    getrandom::fill(&mut bits).map_err(|e| io::Error::other(format!("no random numbers from the system: {e}")))?;
    Ok(bits.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Whether two texts are the same, in a time that does not tell where they differ.
fn same(a: &str, b: &str) -> bool {
    a.len() == b.len() && a.bytes().zip(b.bytes()).fold(0, |differs, (a, b)| differs | (a ^ b)) == 0
}

impl Keys {
    /// New ones.
    ///
    /// # Errors
    /// The system has no random numbers.
    pub(super) fn new() -> io::Result<Self> {
        Ok(Self {
            token: secret()?,
            ticket: Mutex::default(),
        })
    }

    /// What the address of a page that may command ends with.
    pub(super) fn token(&self) -> &str {
        &self.token
    }

    /// A ticket that one page may show once; those before it are void.
    ///
    /// # Errors
    /// The system has no random numbers.
    pub(super) fn new_ticket(&self) -> io::Result<String> {
        let ticket = secret()?;
        *self.ticket.lock().unwrap_or_else(PoisonError::into_inner) = Some(ticket.clone());
        Ok(ticket)
    }

    /// The token, for whoever shows it or the ticket.
    pub(super) fn token_for(&self, shown: &str) -> Option<&str> {
        let mut ticket = self.ticket.lock().unwrap_or_else(PoisonError::into_inner);
        let by_ticket = ticket.take_if(|ticket| same(ticket, shown)).is_some();
        (by_ticket || same(&self.token, shown)).then_some(&self.token)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ticket_is_good_for_one_page_and_the_token_for_all() {
        let keys = Keys::new().unwrap();
        let (first, second) = (keys.new_ticket().unwrap(), keys.new_ticket().unwrap());
        assert_eq!(keys.token_for(&first), None);
        assert_eq!(keys.token_for(""), None);
        for shown in [&keys.token, &second, &keys.token] {
            assert_eq!(keys.token_for(shown), Some(keys.token()));
        }
        assert_eq!(keys.token_for(&second), None);
        let shorter = &keys.token[1..];
        assert_eq!(keys.token_for(shorter), None);
        assert_ne!(Keys::new().unwrap().token, keys.token);
    }
}
