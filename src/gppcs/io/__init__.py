"""Reads and writes point cloud files."""

from gppcs.io.cloud_files import CloudFiles as CloudFiles
from gppcs.io.files import FORMATS as FORMATS
from gppcs.io.files import format_to_write as format_to_write
from gppcs.io.format import Format as Format
from gppcs.io.las import to_laspy as to_laspy
from gppcs.io.reading import read as read
from gppcs.io.streams import check_distinct as check_distinct
from gppcs.io.streams import check_writable as check_writable
from gppcs.io.streams import inner_name as inner_name
from gppcs.io.streams import is_standard as is_standard
from gppcs.io.streams import whole_output as whole_output
from gppcs.io.vpc import files_of as files_of
from gppcs.io.writing import check_storable as check_storable
from gppcs.io.writing import store as store
from gppcs.io.writing import store_in as store_in
from gppcs.io.writing import write as write
