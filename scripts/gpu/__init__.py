"""CUDA is tried: on a machine with a GPU (``run.sh``), and on a stand-in without one (``test_cuda.sh``)."""
