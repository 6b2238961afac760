"""Files of arrays under names: MATLAB, HDF5, TDMS."""
