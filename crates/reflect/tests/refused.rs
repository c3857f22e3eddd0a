//! What cannot stand on the wire does not compile, and the error says what to do.

#[test]
fn what_cannot_stand_on_the_wire_does_not_compile() {
    let cases = trybuild::TestCases::new();
    cases.pass("tests/accepted.rs");
    cases.compile_fail("tests/refused/*.rs");
}
