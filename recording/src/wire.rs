//! A stream of bytes cut into messages of the wire.

/// Longest message that is taken for one: more without a zero is a line that carries something else.
const MOST: usize = 8192;

/// Cuts a stream of bytes at its zeros.
#[derive(Clone, Debug, Default)]
pub struct Splitter {
    begun: Vec<u8>,
    /// Bytes are missing before: what comes up to the next zero is no whole message.
    torn: bool,
}

impl Splitter {
    /// Takes bytes, and hands over what each zero in them ends, the zero included. Zeros with nothing before them are handed over
    /// by nobody. Runs of more than 8 kB without a zero are handed over in pieces.
    pub fn push(&mut self, bytes: &[u8], mut whole: impl FnMut(&[u8])) {
        for byte in bytes {
            self.begun.push(*byte);
            if *byte == 0 || self.begun.len() >= MOST {
                if self.begun.len() > 1 && !self.torn {
                    whole(&self.begun);
                }
                self.torn = self.torn && *byte != 0;
                self.begun.clear();
            }
        }
    }

    /// Bytes were lost here: what was begun is dropped, with what ends it.
    pub fn tear(&mut self) {
        self.begun.clear();
        self.torn = true;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn split(pieces: &[&[u8]]) -> Vec<Vec<u8>> {
        let mut splitter = Splitter::default();
        let mut out = Vec::new();
        for piece in pieces {
            splitter.push(piece, |m| out.push(m.to_vec()));
        }
        out
    }

    proptest! {
        /// However the stream is cut into reads, the messages are the same; and put together they are the stream, but for lone zeros
        /// and what is not ended.
        #[test]
        fn messages_do_not_depend_on_the_reads(
            bytes in prop::collection::vec(0..4_u8, 0..200), at in prop::collection::vec(0..200_usize, 0..8)
        ) {
            let mut at: Vec<usize> = at.into_iter().map(|k| k.min(bytes.len())).chain([0, bytes.len()]).collect();
            at.sort_unstable();
            let pieces: Vec<&[u8]> = at.windows(2).map(|w| &bytes[w[0]..w[1]]).collect();
            let messages = split(&pieces);
            prop_assert_eq!(&messages, &split(&[&bytes]));
            for message in &messages {
                prop_assert!(message.len() > 1 && message.iter().position(|b| *b == 0) == Some(message.len() - 1));
            }
            let joined: Vec<u8> = messages.concat().into_iter().filter(|b| *b != 0).collect();
            let ended = bytes.iter().rposition(|b| *b == 0).map_or(0, |k| k + 1);
            let kept: Vec<u8> = bytes[..ended].iter().copied().filter(|b| *b != 0).collect();
            prop_assert_eq!(joined, kept);
        }
    }

    #[test]
    fn what_was_torn_is_dropped_up_to_the_next_zero() {
        let mut splitter = Splitter::default();
        let mut out = Vec::new();
        splitter.push(&[1, 2], |m| out.push(m.to_vec()));
        splitter.tear();
        splitter.push(&[3, 0, 4, 0], |m| out.push(m.to_vec()));
        assert_eq!(out, [[4, 0]]);
    }
}
