from .cli import main as main
from .reports.figures.contours import ContourRuns as ContourRuns
from .reports.figures.contours import contour_figure as contour_figure
from .reports.figures.contours import error_figure as error_figure
from .reports.page.page_data import StoredRun as StoredRun
