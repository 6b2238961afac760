"""What oscilloscopes write above and beside their samples; each text is made up in the form of real files."""

from prefaces import preface


def test_rigol_numbers_its_samples_and_says_start_and_increment():
    found = preface("""
X,CH1,CH2,Start,Increment,
Sequence,VOLT,Volt,-6.0e-03,1.0e-06,
0,4.00e-02,1.0,
1,-1.20e-01,1.1,
""")
    assert (found.names, found.units) == (("sequence", "CH1", "CH2"), ("", "V", "V"))
    assert (found.left_out, found.time_column, found.period, found.offset) == ({0}, -1, 1e-6, -6e-3)
    assert found.first_row == 3


def test_rigol_pods_of_digital_lines_are_no_samples():
    found = preface("""
X,CH1,D7-D0,D15-D8,Start,Increment,
Sequence,Volt,,,-1.144e-03,2.0e-06
0,4.00e-02,0x00,0x00,
1,-1.20e-01,0x00,0x01,
2,-1.20e-01,0x00,0x01,
""")
    assert found.left_out == {0, 2, 3}


def test_rigol_that_knows_no_increment_has_no_period():
    found = preface("X,CH1,Start,Increment,\nSequence,Volt,0.000E+0,Inf\n0,1.375E+2,\n1,1.4E+2,")
    assert (found.period, found.offset, found.time_column) == (None, 0.0, -1)
