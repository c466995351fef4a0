//! Amplifiers by their words.

use embedded_hal::spi::{ErrorKind, ErrorType, Operation, SpiDevice};
use parts::{Amplifier, Mcp6s2x, Pga11x, Setting};
use std::cell::RefCell;
use std::rc::Rc;

/// What a part is set to: the gain and the input.
type Set = Rc<RefCell<(u16, u8)>>;

/// A part that reads the words of one selection.
struct Part(Set, fn(&[u8], &mut (u16, u8)));

impl ErrorType for Part {
    type Error = ErrorKind;
}

impl SpiDevice for Part {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), ErrorKind> {
        let [Operation::Write(bytes)] = operations else {
            panic!("{operations:?}");
        };
        self.1(bytes, &mut self.0.borrow_mut());
        Ok(())
    }
}

/// SBOS424: 0010 1010, four bits of gain, four of input; gains of the PGA113.
fn pga113(bytes: &[u8], set: &mut (u16, u8)) {
    let [0b0010_1010, data] = *bytes else {
        panic!("{bytes:x?}");
    };
    *set = ([1, 2, 5, 10, 20, 50, 100, 200][usize::from(data >> 4)], data & 15);
}

/// DS21117: 010x xxx0 and the gain, or 010x xxx1 and the input.
fn mcp6s28(bytes: &[u8], set: &mut (u16, u8)) {
    let [instruction, data] = *bytes else {
        panic!("{bytes:x?}");
    };
    assert_eq!(instruction >> 5, 0b010);
    if instruction & 1 == 0 {
        set.0 = [1, 2, 4, 5, 8, 10, 16, 32][usize::from(data)];
    } else {
        set.1 = data;
    }
}

/// Every code and input arrives, by the tables that the drivers publish.
#[test]
fn every_gain_and_input_is_the_one_asked_for() {
    for code in 0..8u8 {
        for channel in 0..2 {
            let (at, source) = (
                Setting { gain: code, channel },
                Setting {
                    gain: 0,
                    channel: 1 - channel,
                },
            );
            let set = Set::default();
            let mut pga = Pga11x::new(Part(set.clone(), pga113), [at, source], Some(source));
            assert_eq!(pga.set_gain(0), Ok(true));
            assert_eq!(*set.borrow(), (Pga11x::<Part, 2>::SCOPE[usize::from(code)], channel));
            assert_eq!(pga.look_at_source(), Ok(true));
            assert_eq!(*set.borrow(), (1, 1 - channel));
            let mut mcp = Mcp6s2x::new(Part(set.clone(), mcp6s28), [source, at], Some(source));
            assert_eq!(mcp.set_gain(1), Ok(true));
            assert_eq!(*set.borrow(), (Mcp6s2x::<Part, 2>::TABLE[usize::from(code)], channel));
            assert_eq!(mcp.look_at_source(), Ok(true));
            assert_eq!(*set.borrow(), (1, 1 - channel));
        }
    }
}

#[test]
fn a_gain_or_an_input_that_is_not_there_is_said_and_nothing_is_sent() {
    let set = Set::default();
    let mut pga = Pga11x::new(Part(set.clone(), pga113), [Setting { gain: 3, channel: 0 }], None);
    assert_eq!((pga.set_gain(1), pga.look_at_source()), (Ok(false), Ok(false)));
    let mut mcp = Mcp6s2x::new(Part(set.clone(), mcp6s28), [], None);
    assert_eq!((mcp.set_gain(0), mcp.look_at_source()), (Ok(false), Ok(false)));
    assert_eq!(*set.borrow(), (0, 0));
}
