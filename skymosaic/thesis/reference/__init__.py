"""Methods of the thesis that the pipeline does not use: the tests compare what it uses with them."""
