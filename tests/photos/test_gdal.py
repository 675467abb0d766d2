"""Files and names that have GDAL open something else: refused, without a call and without a foreign byte."""

import os
import zipfile
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from listener import listening

from zpm2.errors import InputError
from zpm2.formats.regions.labels import open_labels
from zpm2.photos.source import open_source

rasterio = pytest.importorskip("rasterio")
pytestmark = pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
from zpm2.photos import gdal  # noqa: E402
from zpm2.photos.raster import open_raster  # noqa: E402

SIDE = 64
PIXELS = np.random.default_rng(0).integers(0, 256, (1, SIDE, SIDE), np.uint8)
SECRET = b"root:x:0:0:secret\n" * SIDE * SIDE


def tiff(path, **metadata):
    path.parent.mkdir(parents=True, exist_ok=True)
    with rasterio.open(path, "w", driver="GTiff", width=SIDE, height=SIDE, count=1, dtype="uint8") as file:
        file.write(PIXELS)
        if metadata:
            file.update_tags(**metadata)
    return path


def vrt(body="", root="", band=""):
    return (
        f'<VRTDataset rasterXSize="{SIDE}" rasterYSize="{SIDE}"{root}>'
        f'<VRTRasterBand dataType="Byte" band="1"{band}>{body}</VRTRasterBand></VRTDataset>'
    )


def source(name, relative=1, kind="SimpleSource", more=""):
    return (
        f'<{kind}><SourceFilename relativeToVRT="{relative}">{name}</SourceFilename><SourceBand>1</SourceBand>'
        f"{more}</{kind}>"
    )


WMS = "<GDAL_WMS><Service name='TMS'><ServerUrl>{url}/${{z}}/${{x}}/${{y}}.png</ServerUrl></Service><DataWindow>"
WMS += "<UpperLeftX>-20</UpperLeftX><UpperLeftY>20</UpperLeftY><LowerRightX>20</LowerRightX><LowerRightY>-20"
WMS += "</LowerRightY><SizeX>64</SizeX><SizeY>64</SizeY><TileLevel>0</TileLevel></DataWindow><BandsCount>1</BandsCount>"
WMS += "<BlockSizeX>64</BlockSizeX><BlockSizeY>64</BlockSizeY></GDAL_WMS>"
RAW = '<SourceFilename relativeToVRT="0">{secret}</SourceFilename><ByteOrder>LSB</ByteOrder><ImageOffset>0'
RAW += "</ImageOffset><PixelOffset>1</PixelOffset><LineOffset>64</LineOffset>"
ATTACKS = {
    "web": vrt(source("/vsicurl/{url}/a.tif", 0)),
    "streamed": vrt(source("/vsicurl_streaming/{url}/a.tif", 0)),
    "web, relative": vrt(source("/vsicurl/{url}/a.tif")),
    "web, default": vrt(source("/vsicurl/{url}/a.tif").replace(' relativeToVRT="1"', "")),
    "address": vrt(source("{url}/a.tif", 0)),
    "blank before": vrt(source(" /vsicurl/{url}/a.tif", 0)),
    "WMS": vrt(source("WMS:{url}?SERVICE=WMS&amp;LAYERS=a", 0)),
    "WCS": vrt(source("WCS:{url}/?coverage=a", 0)),
    "zip": vrt(source("/vsizip/{folder}/a.zip/a.tif", 0)),
    "tar": vrt(source("/vsitar/{folder}/a.tar/a.tif", 0)),
    "inline": vrt(source("&lt;VRTDataset/&gt;", 0)),
    "vrt name": vrt(source("vrt://{folder}/a.tif", 0)),
    "absolute": vrt(source("{other}/b.tif", 0)),
    "absolute, relative": vrt(source("{other}/b.tif")),
    "above": vrt(source("../other/b.tif")),
    "below": vrt(source("below/b.tif")),
    "link": vrt(source("link.tif")),
    "linked folder": vrt(source("linked/b.tif")),
    "complex": vrt(source("{other}/b.tif", 0, "ComplexSource")),
    "mask": vrt(source("a.tif")).replace(
        "</VRTDataset>",
        "<MaskBand>" + vrt(source("/vsicurl/{url}/a.tif", 0)).split(">", 1)[1][:-13] + "</MaskBand></VRTDataset>",
    ),
    "nested": vrt(source("web.vrt")),
    "nested, called tif": vrt(source("web.tif")),
    "nested WMS": vrt(source("wms.tif")),
    "nested JPEG with a text": vrt(source("polyglot.jpg")),
    "itself": vrt(source("attack.tif")),
    "raw": vrt(RAW, band=' subClass="VRTRawRasterBand"'),
    "raw, in small letters": vrt(RAW, band=' subclass="VRTRawRasterBand"'),
    "derived": vrt(
        "<PixelFunctionType>sqrt</PixelFunctionType>" + source("a.tif"), band=' subClass="VRTDerivedRasterBand"'
    ),
    "python": vrt(
        "<PixelFunctionType>f</PixelFunctionType><PixelFunctionLanguage>Python</PixelFunctionLanguage>"
        "<PixelFunctionCode>open('{folder}/trap', 'w')</PixelFunctionCode>" + source("a.tif"),
        band=' subClass="VRTDerivedRasterBand"',
    ),
    "warped": vrt(root=' subClass="VRTWarpedDataset"').replace(
        "</VRTDataset>", "<GDALWarpOptions><SourceDataset>{other}/b.tif</SourceDataset></GDALWarpOptions></VRTDataset>"
    ),
    "pansharpened": vrt(root=' subClass="VRTPansharpenedDataset"'),
    "name as attribute": vrt('<SimpleSource SourceFilename="/vsicurl/{url}/a.tif"/>'),
    "name in small letters": vrt(source("/vsicurl/{url}/a.tif", 0).replace("SourceFilename", "sourcefilename")),
    "comment in a name": vrt(source("/vsicurl/{url}/a.tif<!-- -->", 0)),
    "entity": '<!DOCTYPE a [<!ENTITY b SYSTEM "/etc/passwd">]>' + vrt(source("&b;")),
    "options": vrt(source("a.tif", more="<OpenOptions><OOI key='ROOT_PATH'>/</OOI></OpenOptions>")),
    "other folder": vrt(source("a.tif", more="<SourceProperties RootPath='/'/>")),
    "overviews": vrt(source("a.tif")).replace(
        "<VRTRaster",
        '<Metadata domain="OVERVIEWS"><MDI key="OVERVIEW_FILE">/vsicurl/{url}/o.tif</MDI></Metadata><VRTRaster',
    ),
    "WMS alone": WMS,
    "WMTS alone": "<GDAL_WMTS><GetCapabilitiesUrl>{url}/c.xml</GetCapabilitiesUrl></GDAL_WMTS>",
    "WCS alone": "<WCS_GDAL><ServiceURL>{url}/</ServiceURL><CoverageName>a</CoverageName></WCS_GDAL>",
    "tile index": "<GDALTileIndexDataset><IndexDataset>{url}/a.gpkg</IndexDataset></GDALTileIndexDataset>",
    "STAC": '{{"type": "Feature", "stac_version": "1", "assets": {{"a": {{"href": "{url}/a.tif"}}}}}}',
}


@pytest.fixture
def trap(tmp_path):
    """A folder with good files, one beside it with others, and links between."""
    folder, other = tmp_path / "folder", tmp_path / "other"
    for path in (folder / "a.tif", folder / "below" / "b.tif", other / "b.tif"):
        tiff(path)
    (folder / "link.tif").symlink_to(other / "b.tif")
    (folder / "linked").symlink_to(other)
    (tmp_path / "secret").write_bytes(SECRET)
    with zipfile.ZipFile(folder / "a.zip", "w") as archive:
        archive.write(folder / "a.tif", "a.tif")
    with listening() as calls:
        words = {"url": calls.address, "folder": folder, "other": other, "secret": tmp_path / "secret"}

        def put(text, name="attack.tif"):
            (folder / name).write_text(text.format(**words))
            return folder / name

        put(ATTACKS["web"], "web.vrt")
        put(ATTACKS["web"], "web.tif")
        put(WMS, "wms.tif")
        (folder / "polyglot.jpg").write_bytes(b"\xff\xd8\xff\xfe\x7f\x7f" + ATTACKS["web"].format(**words).encode())
        yield put, calls
        assert calls.calls == []
    assert not (folder / "trap").exists()


@pytest.mark.parametrize("name", ATTACKS)
def test_a_tif_that_leads_elsewhere_is_refused(trap, name):
    put, _ = trap
    path = put(ATTACKS[name])
    with pytest.raises(InputError) as caught:
        open_source(path, "left image").read()
    assert str(caught.value).startswith(("left image", "source ")), caught.value
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError):
        open_labels(path)


@pytest.mark.parametrize(
    "name",
    [
        *("{url}/a.tif", "/vsicurl/{url}/a.tif", "WCS:{url}/?coverage=a", "WMS:{url}?LAYERS=a", "WMTS:{url}/c.xml"),
        *("HTTP:{url}", "vrt://{folder}/a.tif?bands=1", "zip://{folder}/a.zip!a.tif", "/vsizip/{folder}/a.zip/a.tif"),
        *("zip+{url}/a.zip!a.tif", "file://{folder}/a.tif", "s3://bucket/a.tif", "DERIVED_SUBDATASET:AMPLITUDE:a.tif"),
        *(
            "<VRTDataset/>",
            "PLMOSAIC:",
            "STACIT:{url}/a.json",
            "ZARR:/vsicurl/{url}",
            "GTIFF_DIR:1:/vsicurl/{url}/a.tif",
        ),
    ],
)
def test_names_that_are_none_of_a_file_are_refused(trap, name):
    _, calls = trap
    folder = Path(trap[0]("x", "x").parent)
    name = name.format(url=calls.address, folder=folder)
    for given in (name, Path(name)):
        with pytest.raises(InputError, match="does not exist"):
            open_source(given)
    with pytest.raises(InputError, match="does not exist"):
        open_raster(name)


@pytest.mark.parametrize(
    "kind", ["a.tif.ovr", "a.tif.OVR", "a.tif.msk", "a.tif.aux.xml", "in the file", "a.tif.ovr's own"]
)
@pytest.mark.parametrize("through", ["a.tif", "b.vrt"])
def test_side_files_that_lead_elsewhere_are_refused(trap, kind, through):
    put, calls = trap
    put(vrt(source("a.tif")), "b.vrt")
    away = f"/vsicurl/{calls.address}/o.tif"
    folder = put("x", "x").parent
    if kind == "in the file":
        tiff(folder / "a.tif", ns="OVERVIEWS", OVERVIEW_FILE=away)
    elif kind == "a.tif.ovr's own":
        tiff(folder / "c.tif", ns="OVERVIEWS", OVERVIEW_FILE=away).rename(folder / "a.tif.ovr")
    elif kind == "a.tif.aux.xml":
        mdi = f'<Metadata domain="OVERVIEWS"><MDI key="OVERVIEW_FILE">{away}</MDI></Metadata>'
        put(f"<PAMDataset>{mdi}</PAMDataset>", kind)
    else:
        put(ATTACKS["web"], kind)
    with pytest.raises(InputError, match=r"side file|names other files for its overviews"):
        open_raster(folder / through).read(None, (32, 32))


def test_a_reference_system_is_no_address(trap):
    put, calls = trap
    address = f"<SRS>{calls.address}/crs</SRS>"
    with open_raster(put(vrt(source("a.tif")).replace("<VRTRaster", f"{address}<VRTRaster"))) as opened:
        assert opened.geo.crs is None
    put(f"<PAMDataset>{address}</PAMDataset>", "a.tif.aux.xml")
    with pytest.raises(InputError, match="ALLOW_NETWORK_ACCESS=NO"):
        open_raster(put("x", "x").parent / "a.tif")


def test_sources_beside_a_vrt_and_below_allowed_folders_are_read(trap, run, monkeypatch):
    put, _ = trap
    beside = put(vrt(source("a.tif")), "good.tif")  # whatever it is called
    for name in (source("good.tif"), source(f"{beside.parent}/a.tif", 0), source("a.tif", kind="ComplexSource")):
        with open_raster(put(vrt(name))) as opened:
            assert np.array_equal(opened.read().rgb[..., 0], PIXELS[0])
    folder = beside.parent
    away = {
        "below": folder,
        "above": folder.parent / "other",
        "link": folder.parent / "other",
        "absolute": folder.parent,
    }
    for kind, allowed in away.items():
        path = put(ATTACKS[kind])
        monkeypatch.setenv("ZPM2_ALLOW_VRT", "")
        with pytest.raises(InputError, match=r"does not lie beside it: .* --allow-vrt"):
            open_raster(path)
        monkeypatch.setenv("ZPM2_ALLOW_VRT", f"{folder / 'below'}{os.pathsep}{allowed}")
        with open_raster(path) as opened:
            assert np.array_equal(opened.read().rgb[..., 0], PIXELS[0])


def test_the_option_is_checked(run, tmp_path):
    done = run("match", "a.tif", "b.tif", "--allow-vrt", tmp_path / "none", "-o", tmp_path / "out")
    assert done.code == 2
    assert "is not a folder" in done.err


def test_a_long_chain_of_vrts_is_refused(trap):
    put, _ = trap
    for k in range(40):
        put(vrt(source(f"{k + 1}.vrt" if k < 39 else "a.tif")), f"{k}.vrt")
    with open_raster(put("x", "x").parent / "35.vrt") as opened:
        assert opened.read().rgb.any()
    with pytest.raises(InputError, match="nests VRTs more than 8 deep"):
        open_raster(put("x", "x").parent / "0.vrt")


def test_the_configuration_of_other_code_stays(trap, tmp_path):
    put, _ = trap
    with rasterio.Env(CPL_VSIL_CURL_ALLOWED_FILENAME="mine", GDAL_VRT_ENABLE_PYTHON="TRUSTED_MODULES"):
        with open_raster(put("x", "x").parent / "a.tif") as opened:
            opened.read()
        assert rasterio.env.getenv()["CPL_VSIL_CURL_ALLOWED_FILENAME"] == "mine"
    with rasterio.open(tiff(tmp_path / "a.tif")) as file:
        file.read()
    assert not rasterio.env.hasenv() or not set(gdal.SETTINGS) & set(rasterio.env.getenv())


def test_postscript_called_png_starts_nothing(tmp_path, monkeypatch):
    """Pillow has Ghostscript run it."""
    path = tmp_path / "a.png"
    path.write_bytes(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 64 64\n%%EndComments\n%%EOF\n")
    with PIL.Image.open(path) as picture:
        assert picture.format == "EPS"
    monkeypatch.setattr("subprocess.Popen", None)
    for read in (open_source, open_labels):
        with pytest.raises(InputError):
            read(path)


@pytest.mark.parametrize("format", ["EPS", "FITS", "SPIDER", "XBM", "MSP", "PDF"])
def test_pictures_of_formats_that_are_not_listed_are_refused(tmp_path, format):
    mode = {"SPIDER": "F", "XBM": "1", "MSP": "1"}.get(format, "L")
    path = tmp_path / f"a.{format}"  # Pillow keeps the ending of what it saves as SPIDER
    try:
        PIL.Image.fromarray(PIXELS[0]).convert(mode).save(path, format)
    except (KeyError, OSError):
        path.write_bytes(b"SIMPLE  =                    T")
    with pytest.raises(InputError, match="not a picture in a known format"):
        open_source(path)
